# mypy: disable-error-code="arg-type"
"""Raw signals and ephemerides for tests: drawn at random, and real ones out of broadcast files by pyrtklib."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pyrtklib

from fusion.formats.receiver.subframes import beidou, inav, lnav
from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    GALILEO,
    GLONASS,
    GPS,
    GPS_EPOCH_S,
    QZSS,
    WEEK_S,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
    Signals,
    gps_from_unix,
)
from source_tree import REPOSITORY

BROADCASTS = Path(REPOSITORY).parent / "shared/data/gnss"
START_GPS_S = 2250 * WEEK_S + 2 * 86400 + 5 * 3600 + 18
L1_HZ = {GPS: 1575.42e6, QZSS: 1575.42e6, GALILEO: 1575.42e6, BEIDOU: 1561.098e6}
_FIRST_SATELLITE = {GPS: 0, GLONASS: 32, GALILEO: 59, QZSS: 95, BEIDOU: 105}
"""pyrtklib's number of a system's satellite 1, less 1."""
_COLUMNS = {
    "eccentricity": "e", "m0_rad": "M0", "delta_n_radps": "deln", "omega0_rad": "OMG0", "omega_rad": "omg",
    "omega_dot_radps": "OMGd", "i0_rad": "i0", "i_dot_radps": "idot", "cuc_rad": "cuc", "cus_rad": "cus",
    "crc_m": "crc", "crs_m": "crs", "cic_rad": "cic", "cis_rad": "cis", "af0_s": "f0", "af1": "f1", "af2_per_s": "f2",
}  # fmt: skip


def satellite_of(number: int) -> tuple[int, int]:
    """System and number of pyrtklib's satellite number."""
    system = max(
        (s for s, first in _FIRST_SATELLITE.items() if first < number), key=_FIRST_SATELLITE.__getitem__
    )
    return system, number - _FIRST_SATELLITE[system]


def kepler_from(records: list[pyrtklib.eph_t]) -> KeplerEphemerides:
    """pyrtklib's records as ours."""
    names = [satellite_of(e.sat) for e in records]
    system = np.array([s for s, _ in names])
    group = [e.tgd[1] if s == GALILEO else e.tgd[0] for (s, _), e in zip(names, records, strict=True)]
    return KeplerEphemerides(
        system=system,
        number=np.array([n for _, n in names]),
        toe_s=np.array([e.toe.time + e.toe.sec - GPS_EPOCH_S for e in records]),
        toc_s=np.array([e.toc.time + e.toc.sec - GPS_EPOCH_S for e in records]),
        sent_s=np.array([e.ttr.time + e.ttr.sec - GPS_EPOCH_S for e in records]),
        healthy=np.array([e.svh == 0 for e in records]),
        accuracy_m=np.full(len(records), 2.0),
        issue=np.array([e.iode for e in records]),
        root_a=np.sqrt([e.A for e in records]),
        group_delay_s=np.array(group),
        **{ours: np.array([getattr(e, theirs) for e in records]) for ours, theirs in _COLUMNS.items()},
    )


def broadcast(name: str) -> Navigation:
    """A broadcast file; the caller skips where it is missing."""
    nav = pyrtklib.nav_t()
    pyrtklib.readrnx(str(BROADCASTS / name), 1, "", None, nav, None)
    kepler = [nav.eph[k] for k in range(nav.n) if nav.eph[k].sat > 59 or nav.eph[k].sat < 33]
    return Navigation(kepler_from(kepler), glonass_from([nav.geph[k] for k in range(nav.ng)]))


def glonass_from(records: list[pyrtklib.geph_t]) -> GlonassEphemerides:
    """pyrtklib's records as ours."""
    return GlonassEphemerides(
        number=np.array([satellite_of(g.sat)[1] for g in records], np.int64),
        channel=np.array([g.frq for g in records], np.int64),
        toe_s=np.array([g.toe.time + g.toe.sec - GPS_EPOCH_S for g in records]),
        healthy=np.array([g.svh == 0 for g in records], bool),
        clock_s=-np.array([g.taun for g in records]),
        clock_rate=np.array([g.gamn for g in records]),
        **{
            ours: np.array([[getattr(g, theirs)[k] for k in range(3)] for g in records]).reshape(-1, 3)
            for ours, theirs in (("position_m", "pos"), ("velocity_mps", "vel"), ("acceleration_mps2", "acc"))
        },
    )


def random_kepler(system: int, numbers: list[int], seed: int, toe_s: float) -> KeplerEphemerides:
    """Records whose every field is drawn from all that its bits can say, and is exact in them."""
    rng = np.random.default_rng(seed)
    parts = {GPS: lnav.PARTS, QZSS: lnav.PARTS, GALILEO: inav.PARTS}.get(system)
    places = parts.values() if parts else beidou.D1.values() if 5 < numbers[0] < 59 else [beidou.D2]
    layout = {name: field for part in places for name, field in part.items()}
    n = len(numbers)
    names = {spec.name for spec in fields(KeplerEphemerides)}
    out = {}
    for name, field in layout.items():
        size = len(field.columns)
        low, high = (-(1 << (size - 1)), 1 << (size - 1)) if field.signed else (0, 1 << size)
        out[name] = rng.integers(low, high, n) * field.scale
    metres = layout["root_a"].scale
    out["root_a"] = np.round(rng.uniform(5000, 6500, n) / metres) * metres
    small = layout["eccentricity"].scale
    out["eccentricity"] = np.round(rng.uniform(0, 0.2, n) / small) * small
    return KeplerEphemerides(
        system=np.full(n, system),
        number=np.array(numbers),
        toe_s=np.full(n, toe_s),
        toc_s=np.full(
            n, toe_s - (0.0 if system == BEIDOU else 3600.0)
        ),  # pyrtklib wants BeiDou's to be the same
        sent_s=np.full(n, np.nan),
        healthy=rng.random(n) < 0.5,
        accuracy_m=np.full(n, 0.25 if system == GALILEO else 4.0),
        **{name: column for name, column in out.items() if name in names},
    )


def random_navigation(seed: int, start_s: float = START_GPS_S) -> Navigation:
    """Several satellites of each system, with reference times near the start."""
    rng = np.random.default_rng(seed)
    toe_s = np.round(start_s / 3600) * 3600
    kepler = random_kepler(GPS, [1, 17, 32], seed, toe_s)
    for system, numbers, late_s in (
        (QZSS, [1, 7], 0.0),
        (GALILEO, [2, 33, 36], 0.0),
        (BEIDOU, [6, 30, 58], BEIDOU_LATE_S),
        (BEIDOU, [3, 60], BEIDOU_LATE_S),
    ):
        kepler = kepler.joined(random_kepler(system, numbers, seed, toe_s + late_s))
    quarter = (
        np.round((start_s + GPS_EPOCH_S) / 900) * 900
    )  # quarters of an hour of UTC, whatever the leap seconds
    axis = rng.normal(size=(3, 3))
    place = 25.5e6 * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    states = GlonassEphemerides(
        number=np.array([1, 9, 24]),
        channel=np.array([-7, 0, 6]),
        toe_s=np.repeat(gps_from_unix(np.array([quarter])), 3),
        healthy=rng.random(3) < 0.5,
        clock_s=rng.integers(-(2**21) + 1, 2**21, 3) * 2.0**-30,
        clock_rate=rng.integers(-1023, 1024, 3) * 2.0**-40,
        position_m=np.round(place / (1e3 * 2.0**-11)) * 1e3 * 2.0**-11,
        velocity_mps=rng.integers(-(2**22), 2**22, (3, 3)) * 1e3 * 2.0**-20,
        acceleration_mps2=rng.integers(-15, 16, (3, 3)) * 1e3 * 2.0**-30,
    )
    scales = [lnav.IONOSPHERE[f"{kind}{k}"].scale for kind in ("alpha", "beta") for k in range(4)]
    klobuchar = tuple(float(c) for c in rng.integers(-128, 127, 8) * scales)
    return Navigation(kepler, states, klobuchar)


def signals_of(navigation: Navigation, seed: int, epochs: int = 61, start_s: float = START_GPS_S) -> Signals:
    """Each satellite measured every second, with numbers that say nothing of where it is."""
    rng = np.random.default_rng(seed)
    kepler, states = navigation.kepler, navigation.glonass
    names = list(dict.fromkeys(zip(kepler.system.tolist(), kepler.number.tolist(), strict=True)))
    channel = dict(zip(states.number.tolist(), states.channel.tolist(), strict=True))
    hertz = [L1_HZ[s] for s, _ in names] + [1602e6 + 562_500.0 * c for c in channel.values()]
    names += [(GLONASS, number) for number in channel]
    n = epochs * len(names)
    return Signals.assemble(
        np.repeat(start_s + np.arange(epochs), len(names)),
        np.tile([s for s, _ in names], epochs),
        np.tile([k for _, k in names], epochs),
        pseudorange_m=rng.uniform(2e7, 2.6e7, n),
        range_rate_mps=rng.uniform(-900, 900, n),
        cn0_dbhz=rng.integers(15, 55, n).astype(float),
        sigma_m=0.01 * 2.0 ** rng.integers(3, 12, n),
        frequency_hz=np.tile(hertz, epochs),
    )


def by_satellite(records: KeplerEphemerides | GlonassEphemerides) -> dict[str, np.ndarray]:
    """The columns, sorted by system, satellite and reference time."""
    system = getattr(records, "system", np.zeros(len(records)))
    order = np.lexsort((records.toe_s, records.number, system))
    return {spec.name: getattr(records, spec.name)[order] for spec in fields(records)}
