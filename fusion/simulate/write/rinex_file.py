"""Raw measurements and ephemerides as RINEX 3.04 files, as receivers and services write them.

One signal of each satellite: C/A, E1 C, B1I. What RINEX has and the tables do not (phases, say) is left
blank or 0.
"""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta

import numpy as np

from fusion.signals import (
    BEIDOU,
    BEIDOU_LATE_S,
    BEIDOU_WEEK_0,
    CARRIER_HZ,
    GALILEO,
    GLONASS,
    GLONASS_STEP_HZ,
    GPS_EPOCH_S,
    LIGHT_MPS,
    SYSTEMS,
    WEEK_S,
    KeplerEphemerides,
    Navigation,
    Signals,
    satellite_name,
    unix_from_gps,
)
from fusion.types import Floats

_SIGNAL = {"C": "2I"}
_INAV_SOURCES = 517
"""I/NAV from E1-B and E5b, clock for the pair E1/E5b."""
_UNHEALTHY = 63
_NO_TIME = 9.999e8
_PROGRAM = "versant"


def observations(signals: Signals, place_m: Floats | None = None) -> str:
    """The text of an observation file with pseudorange, Doppler and C/N0; what is NaN is left blank.

    ``place_m`` (3,) is where a base's antenna stands, ECEF.
    """
    lines = _begin("OBSERVATION DATA", "M")
    if place_m is not None:
        lines.append(_header("".join(f"{v:14.4f}" for v in place_m), "APPROX POSITION XYZ"))
    for letter in (SYSTEMS[s] for s in np.unique(signals.system)):
        code = _SIGNAL.get(letter, "1C")
        lines.append(_header(f"{letter}    3 C{code} D{code} S{code}", "SYS / # / OBS TYPES"))
    if len(signals):
        first = _calendar(float(signals.gps_s[0]))
        lines.append(
            _header(f"{first.year:6}{first.month:6}{first.day:6}{first.hour:6}{first.minute:6}"
                    f"{first.second:5}.0000000     GPS", "TIME OF FIRST OBS")
        )  # fmt: skip
    lines += _channels(signals)
    lines.append(_header("", "END OF HEADER"))
    doppler_hz = -signals.range_rate_mps * signals.frequency_hz / LIGHT_MPS
    for k, gps_s in enumerate(signals.gps_s.tolist()):
        rows = range(signals.first[k], signals.first[k + 1])
        lines.append(f"> {_epoch(gps_s)}  0{len(rows):3}")
        for r in rows:
            values = (signals.pseudorange_m[r], doppler_hz[r], signals.cn0_dbhz[r])
            cells = "".join(f"{v:14.3f}  " if np.isfinite(v) else " " * 16 for v in values)
            lines.append((satellite_name(signals.system[r], signals.number[r]) + cells).rstrip())
    return "\n".join(lines) + "\n"


def navigation(data: Navigation) -> str:
    """The text of a navigation file with all the ephemerides and the ionosphere."""
    lines = _begin("N: GNSS NAV DATA", "M: MIXED")
    if data.klobuchar:
        for name, four in (("GPSA", data.klobuchar[:4]), ("GPSB", data.klobuchar[4:])):
            lines.append(_header(f"{name} " + "".join(f"{v:12.4E}" for v in four), "IONOSPHERIC CORR"))
    lines.append(_header("", "END OF HEADER"))
    for row in range(len(data.kepler)):
        lines += _kepler(data.kepler, row)
    lines += _glonass(data)
    return "\n".join(lines) + "\n"


def _begin(kind: str, systems: str) -> list[str]:
    version = f"{'3.04':>9}{'':11}{kind:20}{systems:20}"
    return [_header(version, "RINEX VERSION / TYPE"), _header(f"{_PROGRAM:20}", "PGM / RUN BY / DATE")]


def _header(content: str, label: str) -> str:
    return f"{content:60}{label}"


def _calendar(seconds: float) -> datetime:
    """The calendar of GPS seconds, or of another scale's since the same midnight; whole seconds."""
    return datetime(1980, 1, 6) + timedelta(seconds=int(np.floor(seconds)))  # noqa: DTZ001 - not UTC


def _epoch(gps_s: float) -> str:
    """As in epoch lines, to 100 ns."""
    whole_s, parts = divmod(round(gps_s * 1e7), 10**7)
    return f"{_calendar(whole_s):%Y %m %d %H %M %S}.{parts:07d}"


def _channels(signals: Signals) -> list[str]:
    is_glonass = (signals.system == GLONASS) & np.isfinite(signals.frequency_hz)
    slots, at = np.unique(signals.number[is_glonass], return_index=True)
    hz = signals.frequency_hz[is_glonass][at]
    cells = [
        f"R{slot:02d} {round((f - CARRIER_HZ[GLONASS]) / GLONASS_STEP_HZ):2d} "
        for slot, f in zip(slots, hz, strict=True)
    ]
    return [
        _header(f"{len(cells) if not i else '':>3} " + "".join(cells[i : i + 8]), "GLONASS SLOT / FRQ #")
        for i in range(0, len(cells), 8)
    ]


def _record(system: int, number: int, seconds: float, values: list[float]) -> Iterator[str]:
    """The lines of a record; ``seconds`` on the calendar of its system, the first three values on the first line."""
    cells = ["" if np.isnan(v) else f"{v:19.12E}" for v in values]
    yield f"{satellite_name(system, number)} {_calendar(seconds):%Y %m %d %H %M %S}" + "".join(cells[:3])
    for at in range(3, len(cells), 4):
        yield ("    " + "".join(f"{cell:19}" for cell in cells[at : at + 4])).rstrip()


def _kepler(table: KeplerEphemerides, row: int) -> Iterator[str]:
    e = {name: column[row].item() for name, column in vars(table).items()}
    system = e["system"]
    late = BEIDOU_LATE_S if system == BEIDOU else 0.0
    toe, toc, sent = e["toe_s"] - late, e["toc_s"] - late, e["sent_s"] - late
    week = toe // WEEK_S - (BEIDOU_WEEK_0 if system == BEIDOU else 0)
    health = 0.0 if e["healthy"] else float(_UNHEALTHY)
    accuracy = 0.0 if np.isnan(e["accuracy_m"]) else e["accuracy_m"]
    delay = [0.0, e["group_delay_s"]] if system == GALILEO else [e["group_delay_s"], 0.0]
    return _record(system, e["number"], toc, [
        e["af0_s"], e["af1"], e["af2_per_s"],
        float(e["issue"]), e["crs_m"], e["delta_n_radps"], e["m0_rad"],
        e["cuc_rad"], e["eccentricity"], e["cus_rad"], e["root_a"],
        toe % WEEK_S, e["cic_rad"], e["omega0_rad"], e["cis_rad"],
        e["i0_rad"], e["crc_m"], e["omega_rad"], e["omega_dot_radps"],
        e["i_dot_radps"], float(_INAV_SOURCES) if system == GALILEO else 0.0, week, 0.0,
        accuracy, health, *delay,
        _NO_TIME if np.isnan(sent) else sent - toe // WEEK_S * WEEK_S,
    ])  # fmt: skip


def _glonass(data: Navigation) -> Iterator[str]:
    table = data.glonass
    utc_s = unix_from_gps(table.toe_s) - GPS_EPOCH_S
    for k in range(len(table)):
        axes = np.column_stack([table.position_m[k], table.velocity_mps[k], table.acceleration_mps2[k]])
        x, y, z = (axes / 1000.0).tolist()
        yield from _record(GLONASS, table.number[k], float(utc_s[k]), [
            table.clock_s[k], table.clock_rate[k], float(utc_s[k] % WEEK_S),
            *x, 0.0 if table.healthy[k] else float(_UNHEALTHY),
            *y, float(table.channel[k]),
            *z, 0.0,
        ])  # fmt: skip
