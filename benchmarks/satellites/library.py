"""Navigation files by an independent library (pyrtklib): its own records, and those in this project's tables.

It is the oracle of tests and benchmarks, and no part of the project.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyrtklib

from fusion.signals import (
    BEIDOU,
    GALILEO,
    GLONASS,
    GPS,
    GPS_EPOCH_S,
    QZSS,
    GlonassEphemerides,
    KeplerEphemerides,
    Navigation,
)
from fusion.types import Floats

BITS_OF_SYSTEMS = {1: GPS, 4: GLONASS, 8: GALILEO, 16: QZSS, 32: BEIDOU}
E5B_CLOCK = 1 << 9
"""In the sources' code of a Galileo record: its clock is for E5b and E1."""
E1_HEALTH = 0b000000111
"""In a Galileo record's health: the bits of E1."""


def library_time(gps_s: float) -> Any:
    """GPS seconds as the library has times."""
    whole = int(np.floor(gps_s))
    time = pyrtklib.gtime_t()
    time.time, time.sec = whole + int(GPS_EPOCH_S), float(gps_s - whole)
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
    whole = Navigation()
    for path in paths:
        read = library_navigation(path)
        alpha_beta = tuple(read.ion_gps[k] for k in range(8))
        whole = whole.joined(
            Navigation(
                kepler_table([kepler_row(r) for r in kepler_records(path)]),
                glonass_table([glonass_row(r) for r in glonass_records(path)]),
                alpha_beta if any(alpha_beta) else None,
            )
        )
    return whole


def library_state(read: Callable[..., None], record: Any, gps_s: float) -> tuple[Floats, float]:
    """Place (3,) and clock (s) that ``eph2pos`` or ``geph2pos`` of the library give by a record."""
    place, clock = pyrtklib.Arr1Ddouble(6), pyrtklib.Arr1Ddouble(2)
    read(library_time(gps_s), record, place, clock, pyrtklib.Arr1Ddouble(1))
    return np.array([place[k] for k in range(3)]), float(clock[0])
