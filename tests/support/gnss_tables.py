"""Raw measurements and ephemerides made up by chance, with every value in its range."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from fusion.signals import (
    BEIDOU,
    GALILEO,
    GLONASS,
    GPS,
    QZSS,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
    Signals,
)

KEPLERIAN = (GPS, GALILEO, BEIDOU, QZSS)
CHANNELS = {1: 1, 2: -4, 3: 5, 4: 6, 5: 1, 6: -4, 7: 5, 8: 6}
"""Of the GLONASS slots that are made up."""


def some_signals(seed: int, epochs: int = 5, began_s: float = 1.38e9, satellites: int = 8) -> Signals:
    """Epochs a second apart (the first at GPS second ``began_s``) of satellites of all systems."""
    rng = np.random.default_rng(seed)
    times, systems, numbers = [], [], []
    for k in range(epochs):
        for system in (*KEPLERIAN, GLONASS):
            seen = rng.choice(np.arange(1, 9), rng.integers(1, satellites + 1), replace=False)
            times += [began_s + k] * len(seen)
            systems += [system] * len(seen)
            numbers += seen.tolist()
    system_of, number_of = np.array(systems), np.array(numbers)
    n = len(times)
    carrier = np.where(system_of == BEIDOU, 1_561_098_000.0, 1_575_420_000.0)
    channel = np.array([CHANNELS[k] for k in numbers])
    carrier = np.where(system_of == GLONASS, 1_602_000_000.0 + 562_500.0 * channel, carrier)
    rate = rng.uniform(-900, 900, n)
    rate[rng.random(n) < 0.1] = np.nan
    return Signals.assemble(
        np.array(times), system_of, number_of, pseudorange_m=np.round(rng.uniform(1.9e7, 4e7, n), 3),
        range_rate_mps=rate, cn0_dbhz=np.round(rng.uniform(15, 55, n), 3), frequency_hz=carrier,
    )  # fmt: skip


def some_navigation(seed: int, records: int = 20, near_s: float = 1.38e9) -> Navigation:
    """Ephemerides within hours of a GPS second, with the ionosphere."""
    rng = np.random.default_rng(seed)
    n = records
    toe = np.round(near_s / 16) * 16 + 16.0 * rng.integers(-400, 400, n)
    kind = {
        "system": rng.choice(KEPLERIAN, n),
        "number": rng.integers(1, 36, n),
        "issue": rng.integers(0, 1024, n),
    }
    special = {
        "toe_s": toe, "toc_s": toe - 16.0 * rng.integers(0, 3, n), "sent_s": toe - 30.0 * rng.integers(0, 200, n),
        "healthy": rng.random(n) < 0.8, "accuracy_m": np.round(rng.uniform(1, 9, n), 2),
        "root_a": rng.uniform(5100, 6500, n), "eccentricity": rng.uniform(0, 0.1, n),
        "crc_m": rng.uniform(-400, 400, n), "crs_m": rng.uniform(-400, 400, n),
        "af0_s": rng.uniform(-1e-3, 1e-3, n), "af1": rng.uniform(-1e-10, 1e-10, n),
        "group_delay_s": rng.uniform(-2e-8, 2e-8, n),
    }  # fmt: skip
    angles = {
        f.name: rng.uniform(-3, 3, n) for f in fields(KeplerEphemerides) if f.name not in {*kind, *special}
    }
    kepler = KeplerEphemerides(**{**kind, **special, **angles})
    slot = rng.integers(1, 9, n)
    way = rng.normal(size=(n, 3))
    glonass = GlonassEphemerides(
        number=slot, channel=np.array([CHANNELS[k] for k in slot.tolist()]),
        toe_s=np.round(near_s / 900) * 900 + 18 + 900.0 * rng.integers(-40, 40, n),
        healthy=rng.random(n) < 0.8, clock_s=rng.uniform(-1e-4, 1e-4, n), clock_rate=rng.uniform(-1e-11, 1e-11, n),
        position_m=2.55e7 * way / np.linalg.norm(way, axis=1, keepdims=True),
        velocity_mps=rng.uniform(-2000, 2000, (n, 3)), acceleration_mps2=rng.uniform(-2e-6, 2e-6, (n, 3)),
    )  # fmt: skip
    return Navigation(kepler, glonass, (1e-8, 2e-8, -6e-8, -1.2e-7, 9e4, 5e4, -1.3e5, -3.3e5))


def agree(a: object, b: object, **tolerance: float) -> bool:
    """Whether two tables hold the same to 12 digits, or to the absolute tolerance that is named for a column."""
    return all(
        np.allclose(
            getattr(a, name), getattr(b, name), rtol=1e-11, atol=tolerance.get(name, 0.0), equal_nan=True
        )
        for name in vars(a)
    )


def rinex_head(
    version: str, *lines: tuple[str, str], kind: str = "OBSERVATION DATA", system: str = "M"
) -> list[str]:
    """A header from contents and labels."""
    first = (f"{version:>9}{'':11}{kind:20}{system:20}", "RINEX VERSION / TYPE")
    return [f"{content:60}{label}" for content, label in (first, *lines, ("", "END OF HEADER"))]
