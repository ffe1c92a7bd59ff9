"""Navigation files by an independent library (pyrtklib): its own records, and those in this project's tables.

It is the oracle of tests and benchmarks, and no part of the project.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyrtklib

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
)
from fusion.types import Floats

BITS_OF_SYSTEMS = {1: GPS, 4: GLONASS, 8: GALILEO, 16: QZSS, 32: BEIDOU}
E5B_CLOCK = 1 << 9
"""In the sources' code of a Galileo record: its clock is for E5b and E1."""
E1_HEALTH = 0b000000111
"""In a Galileo record's health: the bits of E1."""


def library_time(gps_s: float) -> Any:
    """GPS seconds as the library has times."""
    whole_s = int(np.floor(gps_s))
    time = pyrtklib.gtime_t()
    time.time, time.sec = whole_s + int(GPS_EPOCH_S), float(gps_s - whole_s)
    return time


def gps_seconds(time: Any) -> float:
    """The library's time as GPS seconds."""
    return float(time.time) - GPS_EPOCH_S + float(time.sec)


def system_and_number(satellite: int) -> tuple[int, int]:
    """As this project numbers a satellite of the library."""
    number = pyrtklib.Arr1Dint(1)
    system = BITS_OF_SYSTEMS[pyrtklib.satsys(satellite, number)]
    return system, number[0] - (192 if system == QZSS else 0)


@cache
def library_navigation(path: Path) -> Any:
    """A navigation file as the library reads it."""
    navigation = pyrtklib.nav_t()
    if pyrtklib.readrnx(str(path), 1, "", pyrtklib.obs_t(), navigation, pyrtklib.sta_t()) < 0:
        raise ValueError(f"{path} is no navigation file")
    return navigation


def kepler_records(path: Path) -> Iterator[Any]:
    """The file's Keplerian records."""
    read = library_navigation(path)
    return (read.eph[k] for k in range(read.n))


def glonass_records(path: Path) -> Iterator[Any]:
    """The file's GLONASS records."""
    read = library_navigation(path)
    return (read.geph[k] for k in range(read.ng))


def kepler_row(record: Any) -> dict[str, Any]:
    """A record of the library as a row of ours."""
    system, number = system_and_number(record.sat)
    by_e5b = system == GALILEO and record.code & E5B_CLOCK
    healthy = record.svh & E1_HEALTH == 0 if system == GALILEO else record.svh == 0
    return {
        "system": system, "number": number, "toe_s": gps_seconds(record.toe), "toc_s": gps_seconds(record.toc),
        "sent_s": gps_seconds(record.ttr), "healthy": healthy, "accuracy_m": np.nan, "issue": record.iode,
        "root_a": np.sqrt(record.A), "eccentricity": record.e, "m0_rad": record.M0,
        "delta_n_radps": record.deln, "omega0_rad": record.OMG0, "omega_rad": record.omg,
        "omega_dot_radps": record.OMGd, "i0_rad": record.i0, "i_dot_radps": record.idot,
        "cuc_rad": record.cuc, "cus_rad": record.cus, "crc_m": record.crc, "crs_m": record.crs,
        "cic_rad": record.cic, "cis_rad": record.cis, "af0_s": record.f0, "af1": record.f1,
        "af2_per_s": record.f2, "group_delay_s": record.tgd[1 if by_e5b else 0],
    }  # fmt: skip


def glonass_row(record: Any) -> dict[str, Any]:
    """A GLONASS record of the library as a row of ours."""
    return {
        "number": system_and_number(record.sat)[1], "channel": record.frq, "toe_s": gps_seconds(record.toe),
        "healthy": record.svh == 0, "clock_s": -record.taun, "clock_rate": record.gamn,
        "position_m": [record.pos[k] for k in range(3)], "velocity_mps": [record.vel[k] for k in range(3)],
        "acceleration_mps2": [record.acc[k] for k in range(3)],
    }  # fmt: skip


def library_record(row: dict[str, Any]) -> Any:
    """A row of ours as a Keplerian record of the library."""
    record = pyrtklib.eph_t()
    system = int(row["system"])
    bits = {ours: theirs for theirs, ours in BITS_OF_SYSTEMS.items()}[system]
    record.sat = pyrtklib.satno(bits, int(row["number"]) + (192 if system == QZSS else 0))
    record.toe, record.toc = library_time(row["toe_s"]), library_time(row["toc_s"])
    record.toes = (row["toe_s"] - (BEIDOU_LATE_S if system == BEIDOU else 0.0)) % WEEK_S
    record.A, record.e, record.M0, record.deln = (
        row["root_a"] ** 2,
        row["eccentricity"],
        row["m0_rad"],
        row["delta_n_radps"],
    )
    record.OMG0, record.omg, record.OMGd = row["omega0_rad"], row["omega_rad"], row["omega_dot_radps"]
    record.i0, record.idot = row["i0_rad"], row["i_dot_radps"]
    record.cuc, record.cus, record.crc = row["cuc_rad"], row["cus_rad"], row["crc_m"]
    record.crs, record.cic, record.cis = row["crs_m"], row["cic_rad"], row["cis_rad"]
    record.f0, record.f1, record.f2 = row["af0_s"], row["af1"], row["af2_per_s"]
    return record


def kepler_table(rows: list[dict[str, Any]]) -> KeplerEphemerides:
    """Rows as a table."""
    kinds = {s.name: getattr(KeplerEphemerides.empty(), s.name).dtype for s in fields(KeplerEphemerides)}
    return KeplerEphemerides(**{n: np.array([r[n] for r in rows], kind) for n, kind in kinds.items()})


def glonass_table(rows: list[dict[str, Any]]) -> GlonassEphemerides:
    """Rows as a table."""
    empty = GlonassEphemerides.empty()
    shapes = {s.name: getattr(empty, s.name) for s in fields(GlonassEphemerides)}
    return GlonassEphemerides(
        **{n: np.array([r[n] for r in rows], c.dtype).reshape(-1, *c.shape[1:]) for n, c in shapes.items()}
    )


def navigation_of(*paths: Path) -> Navigation:
    """Navigation files, as the library reads them, in this project's tables."""
    joined = Navigation()
    for path in paths:
        read = library_navigation(path)
        alpha_beta = tuple(read.ion_gps[k] for k in range(8))
        joined = joined.joined(
            Navigation(
                kepler_table([kepler_row(r) for r in kepler_records(path)]),
                glonass_table([glonass_row(r) for r in glonass_records(path)]),
                alpha_beta if any(alpha_beta) else None,
            )
        )
    return joined


def library_state(read: Callable[..., None], record: Any, gps_s: float) -> tuple[Floats, float]:
    """Place (3,) and clock (s) that ``eph2pos`` or ``geph2pos`` of the library give by a record."""
    place, clock = pyrtklib.Arr1Ddouble(6), pyrtklib.Arr1Ddouble(2)
    read(library_time(gps_s), record, place, clock, pyrtklib.Arr1Ddouble(1))
    return np.array([place[k] for k in range(3)]), float(clock[0])


def library_position(
    signals: Signals,
    epoch: int,
    navigation: Any,
    ionosphere: int,
    troposphere: int,
    *,
    systems: tuple[int, ...] = (GPS,),
    mask_deg: float = 5.0,
) -> Floats:
    """The place (3,) that the library's single-point positioning finds for an epoch's signals, NaN for none.

    ``ionosphere`` and ``troposphere`` are its options of these names.
    """
    bits = {ours: theirs for theirs, ours in BITS_OF_SYSTEMS.items()}
    span = np.arange(signals.first[epoch], signals.first[epoch + 1])
    rows = span[np.isin(signals.system[span], systems)].tolist()
    if not rows:
        return np.full(3, np.nan)
    observed = pyrtklib.Arr1Dobsd_t(len(rows))
    for k, row in enumerate(rows):
        one, system = observed[k], int(signals.system[row])
        one.time, one.rcv = library_time(float(signals.gps_s[epoch])), 1
        one.sat = pyrtklib.satno(bits[system], int(signals.number[row]) + (192 if system == QZSS else 0))
        one.P[0] = float(signals.pseudorange_m[row])
        one.code[0] = pyrtklib.CODE_L2I if system == BEIDOU else pyrtklib.CODE_L1C
    chosen = pyrtklib.prcopt_t()
    chosen.nf, chosen.navsys, chosen.elmin = 1, sum(bits[s] for s in systems), np.radians(mask_deg)
    chosen.ionoopt, chosen.tropopt, chosen.maxgdop = ionosphere, troposphere, 30.0
    for k, error in enumerate((100.0, 0.003, 0.003)):
        chosen.err[k] = error
    solution, message = pyrtklib.sol_t(), pyrtklib.Arr1Dchar(128)
    angles, states = pyrtklib.Arr1Ddouble(2 * len(rows)), pyrtklib.Arr1Dssat_t(pyrtklib.MAXSAT)
    if not pyrtklib.pntpos(
        observed.ptr, len(rows), navigation, chosen, solution, angles, states.ptr, message
    ):
        return np.full(3, np.nan)
    return np.array([solution.rr[k] for k in range(3)])


def library_single_points(signals: Signals, files: Iterable[Path]) -> Floats:
    """ECEF places (m, 3) of all epochs by the library alone, with its usual settings; RINEX navigation among ``files``.

    Broadcast ionosphere, Saastamoinen, a mask of 15 degrees, GPS, GLONASS, Galileo and BeiDou as far as they are there.
    """
    navigation = pyrtklib.nav_t()
    for path in files:
        pyrtklib.readrnx(str(path), 1, "", pyrtklib.obs_t(), navigation, pyrtklib.sta_t())
    models = pyrtklib.IONOOPT_BRDC, pyrtklib.TROPOPT_SAAS
    systems = tuple(s for s in (GPS, GLONASS, GALILEO, BEIDOU) if np.any(signals.system == s))
    return np.array(
        [
            library_position(signals, k, navigation, *models, systems=systems, mask_deg=15.0)
            for k in range(len(signals))
        ]
    ).reshape(-1, 3)


def library_signals(path: Path) -> Signals:
    """The L1 band of an observation file."""
    observed = pyrtklib.obs_t()
    if pyrtklib.readrnx(str(path), 1, "", observed, pyrtklib.nav_t(), pyrtklib.sta_t()) < 0:
        raise ValueError(f"{path} is no observation file")
    rows = [observed.data[k] for k in range(observed.n)]
    named = np.array([system_and_number(row.sat) for row in rows])
    ranges = np.array([row.P[0] for row in rows])
    return Signals.assemble(
        np.array([gps_seconds(row.time) for row in rows]),
        named[:, 0],
        named[:, 1],
        pseudorange_m=np.where(ranges > 0, ranges, np.nan),
    )
