"""A CSV of pseudoranges: one header, one row per satellite and epoch, perhaps with the satellites' positions."""

from __future__ import annotations

import re
from collections.abc import Collection
from functools import cache

import numpy as np

from fusion.errors import EmptyLogError
from fusion.formats.base import Data, LogFormat, Notes, build_log, is_possible_time, positive
from fusion.formats.tables import header as csv_header
from fusion.formats.tables.cells import Block, read_blocks
from fusion.formats.tables.names import Schema
from fusion.messages import say
from fusion.signals import (
    CARRIER_HZ,
    GLONASS,
    SYSTEMS,
    WEEK_S,
    RawGnss,
    Signals,
    gps_from_unix,
    unix_from_gps,
)
from fusion.types import DriveLog, Floats, Ints, Progress

PSEUDORANGE = "pseudorange_m"
PLACE = ("sat_x_m", "sat_y_m", "sat_z_m")
MOTION = ("sat_vx_mps", "sat_vy_mps", "sat_vz_mps")
_STATED = ("range_rate_mps", "cn0_dbhz", "sigma_m", "frequency_hz")
COLUMNS = (
    "time_s", "gps_week", "tow_s", "system", "satellite", "sv", PSEUDORANGE, *PLACE, *MOTION, *_STATED,
)  # fmt: skip
LARGEST_M = 1e9
_NEAREST_SATELLITE_M = 6e6
_MOST_SATELLITES = 1000


def _lacking(header: Collection[str]) -> list[str]:
    out = []
    if "time_s" not in header and not {"gps_week", "tow_s"} <= set(header):
        out.append("time_s (Unix seconds) or gps_week and tow_s")
    if "sv" not in header and not {"system", "satellite"} <= set(header):
        out.append("sv (such as G07) or system and satellite")
    out += [name for name in (PSEUDORANGE,) if name not in header]
    for triple in (PLACE, MOTION):
        some = [name for name in triple if name in header]
        out += [name for name in triple if name not in header] if some else []
    return out


SCHEMA = Schema(COLUMNS, _lacking, frozenset({"system", "sv"}))


class PseudorangesCsvFormat(LogFormat):
    """Recognised by ``pseudorange_m`` in the header line."""

    name = "pseudoranges-csv"
    description = "CSV of pseudoranges"
    suffixes = (".csv",)
    altitude_advice = say("advice.pseudoranges_altitude")
    doppler_advice = say("advice.pseudoranges_doppler")

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``."""
        return PSEUDORANGE in csv_header.header_of(head).names

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        notes = Notes()
        text = csv_header.from_utf16(bytes(data))
        layout = csv_header.layout_of(text, notes, SCHEMA)
        parts = [_columns(block, notes) for block in read_blocks(text, layout, notes, progress)]
        progress("read rows", 1.0)
        joined = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}
        signals = _signals(joined, notes) if joined else Signals.empty()
        if not len(signals):
            why = say("log.first_fault", fault=notes.first_offender) if notes.first_offender else ""
            raise EmptyLogError(
                say("pseudoranges.none", description=self.description, why=why),
                where=notes.first_place,
            )
        return build_log(self, notes, {}, raw=RawGnss(signals))


def _columns(block: Block, notes: Notes) -> dict[str, Floats]:
    """The rows of a block that can be used, as numbers: system and satellite as well, and GPS seconds."""
    col = {name: block.column(name) for name in COLUMNS}
    stated = np.isfinite(col["time_s"])
    gps_s = np.where(stated, gps_from_unix(np.where(stated, col["time_s"], 0)), np.nan)
    with np.errstate(over="ignore"):
        of_week = col["gps_week"] * WEEK_S + col["tow_s"]
    gps_s = np.where(np.isfinite(gps_s), gps_s, of_week)
    system, number = _satellites(block, col["satellite"])
    time_s = unix_from_gps(np.nan_to_num(gps_s, nan=-1e12))
    faults = (
        ("rows at no possible time", ~is_possible_time(time_s)),
        ("rows of satellites that are not known", (system < 0) | ~((number >= 1) & (number < _MOST_SATELLITES))),
        ("pseudoranges that are missing or cannot be", ~((col[PSEUDORANGE] > 0) & (col[PSEUDORANGE] < LARGEST_M))),
    )  # fmt: skip
    good = notes.sift(faults, block.place, position=True)
    names = (PSEUDORANGE, *PLACE, *MOTION, *_STATED)
    out = {name: col[name][good] for name in names}
    return out | {"gps_s": gps_s[good], "system": system[good].astype(float), "number": number[good]}


def _satellites(block: Block, numbers: Floats) -> tuple[Ints, Floats]:
    """System (-1 if unknown) and number of each row, from ``sv`` where it is filled, else from the two columns."""
    named = [_satellite(name) for name in block.words.get("sv", [""] * len(block))]
    letters = [SYSTEMS.find(c.upper()) if c else -1 for c in block.words.get("system", [""] * len(block))]
    system, number = np.array(named, np.int64).reshape(-1, 2).T
    by_name = number > 0
    return np.where(by_name, system, letters), np.where(by_name, number, numbers)


@cache
def _satellite(name: str) -> tuple[int, int]:
    """System and number of ``G07``; -1 and 0 of what is no such name."""
    match = re.fullmatch(r"([A-Za-z]) ?(\d{1,2})", name[:8])
    return (SYSTEMS.find(match.group(1).upper()), int(match.group(2))) if match else (-1, 0)


def _signals(col: dict[str, Floats], notes: Notes) -> Signals:
    place = np.column_stack([col[name] for name in PLACE])
    motion = np.column_stack([col[name] for name in MOTION])
    with np.errstate(over="ignore"):
        has_place = np.linalg.norm(place, axis=1) > _NEAREST_SATELLITE_M
    keep = has_place if has_place.any() else np.ones(len(has_place), bool)
    if not keep.all():
        notes.skip("rows without the position of their satellite", int((~keep).sum()))
        notes.warn(say("pseudoranges.no_satellite", n=int((~keep).sum())))
    system = col["system"].astype(np.int64)
    usual = np.where(system == GLONASS, np.nan, CARRIER_HZ[system])  # GLONASS has one for every channel
    carrier = np.where(np.isfinite(col["frequency_hz"]), col["frequency_hz"], usual)
    sigma = positive(col["sigma_m"])
    signals = Signals.assemble(
        col["gps_s"][keep], system[keep], col["number"][keep].astype(np.int64),
        pseudorange_m=col[PSEUDORANGE][keep], range_rate_mps=col["range_rate_mps"][keep],
        cn0_dbhz=col["cn0_dbhz"][keep], sigma_m=sigma[keep], frequency_hz=carrier[keep],
        position_m=np.where(has_place[:, None], place, np.nan)[keep], velocity_mps=motion[keep],
    )  # fmt: skip
    notes.skip("repeated rows of one satellite and time", int(keep.sum()) - len(signals.system))
    return signals
