"""Versant CSV: one header, one row per instant, empty cells where a sensor did not measure."""

from __future__ import annotations

import re

import numpy as np

from fusion.formats.base import Data, Notes, build_log, ground_velocity, usable_positions
from fusion.formats.csv_cells import (
    COLUMNS,
    Block,
    Schema,
    delimiter_of,
    first_line,
    from_utf16,
    header_cells,
    layout_of,
    read_blocks,
)
from fusion.formats.gnsslogger import has_log_header
from fusion.formats.pseudoranges_csv import PSEUDORANGE
from fusion.signals import Navigation
from fusion.types import (
    AngularRate,
    Attitude,
    DriveLog,
    Floats,
    GnssFix,
    GnssVelocity,
    Odometry,
    Pressure,
    Progress,
    SensorTable,
    SpecificForce,
)

DEG = np.pi / 180
FREEZING_K = 273.15
_OTHER_KINDS = (b"$", b"<", b"{", b"[", b"%")
_WORST_ACCURACY = 10_000.0


class VersantCsvFormat:
    """``COLUMNS`` in any order; recognised by any header line, refused if required columns are missing."""

    name = "csv"
    description = "Versant CSV"
    suffixes = (".csv",)
    altitude_advice = (
        "Add the column alt_msl_m or height_ell_m, or name the one that holds it, such as `--columns "
        "alt_msl_m=Altitude`."
    )
    doppler_advice = (
        "Add the column vel_d_mps (Doppler velocity downwards), or name the one that holds it by `--columns`."
    )

    def recognises(self, head: bytes) -> bool:
        """See ``LogFormat``: text whose first line has several cells, or one that is a column of ours."""
        head = from_utf16(head[: len(head) // 2 * 2]) if head[:1] in (b"\xff", b"\xfe") else head
        line = first_line(head)[2]
        if not line or line.startswith(_OTHER_KINDS) or re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", head[:4096]):
            return False
        cells = header_cells(line, delimiter_of(line))
        if PSEUDORANGE in cells or has_log_header(head):
            return False
        return any(c in COLUMNS for c in cells) or (len(cells) > 1 and _is_text(line))

    def read(self, data: Data, progress: Progress) -> DriveLog:
        """See ``LogFormat``."""
        return self._read(data, progress, SCHEMA)

    def comes_first(self, head: bytes) -> bool:
        """See ``PartFormat``."""
        return False

    def read_part(self, data: Data, progress: Progress, navigation: Navigation) -> DriveLog:
        """See ``PartFormat``: a CSV of sensors alone needs no columns of positions."""
        return self._read(data, progress, SCHEMA_OF_A_PART)

    def _read(self, data: Data, progress: Progress, schema: Schema) -> DriveLog:
        notes = Notes()
        text = from_utf16(bytes(data))
        parts: dict[str, list[SensorTable]] = {}
        for block, share in read_blocks(text, layout_of(text, notes, schema), notes):
            for name, table in _assemble(block, notes).items():
                if len(table):
                    parts.setdefault(name, []).append(table)
            progress("read rows", share)
        tables = {name: _joined(parts.pop(name), notes) for name in list(parts)}
        progress("read rows", 1.0)
        return build_log("csv", "Versant CSV", notes, tables, part=schema is SCHEMA_OF_A_PART)


def _lacking_time(header: list[str]) -> list[str]:
    return [] if "time_s" in header or "time" in header else ["time_s (Unix seconds) or time (RFC 3339)"]


def _lacking(header: list[str]) -> list[str]:
    return _lacking_time(header) + [name for name in ("lat_deg", "lon_deg") if name not in header]


SCHEMA = Schema(COLUMNS, _lacking)
SCHEMA_OF_A_PART = Schema(COLUMNS, _lacking_time)
"""Where positions come from another file."""


def _is_text(line: bytes) -> bool:
    try:
        return line.decode("utf-8").isprintable() or b"\t" in line
    except UnicodeDecodeError:
        return False


def _joined(parts: list[SensorTable], notes: Notes) -> SensorTable:
    """One table of those of the blocks; disorder between blocks counts like that within one."""
    if len(parts) == 1:
        return parts[0]
    kind = type(parts[0])
    columns = {name: np.concatenate([getattr(p, name) for p in parts]) for name in kind.columns()}
    time_s = np.concatenate([p.time_s for p in parts])
    if np.all(np.diff(time_s) > 0):  # as usual: no need of the copies that sorting takes
        return kind(time_s=time_s, **columns)
    return kind.assemble(time_s, notes.repaired if kind is GnssFix else None, **columns)


def _assemble(block: Block, notes: Notes) -> dict[str, SensorTable]:
    rows = len(next(iter(block.columns.values())))
    unknown = np.full(rows, np.nan)
    col = {name: block.columns.get(name, unknown) for name in COLUMNS}
    _forget_placeholders(col, notes)
    time_s = np.where(np.isfinite(col["time_s"]), col["time_s"], col["time"])
    lat, lon = col["lat_deg"], col["lon_deg"]
    claims = np.isfinite(lat) | np.isfinite(lon)
    good = usable_positions(time_s, lat, lon, notes, block.place, need=claims)
    time_s, col = time_s[good], {name: c[good] for name, c in col.items()}
    here = claims[good]
    north, east = ground_velocity(col["speed_mps"], col["heading_deg"] * DEG)
    has = np.isfinite(col["vel_n_mps"]) & np.isfinite(col["vel_e_mps"])
    velocity = {
        "vel_n_mps": np.where(has, col["vel_n_mps"], north),
        "vel_e_mps": np.where(has, col["vel_e_mps"], east),
        "vel_d_mps": col["vel_d_mps"],
        "s_acc_mps": col["s_acc_mps"],
    }
    moving = np.isfinite(velocity["vel_n_mps"]) | np.isfinite(velocity["vel_d_mps"])
    used = {n: col[n] for n in COLUMNS}
    used |= {n.replace("dps", "radps"): col[n] * DEG for n in COLUMNS if n.endswith("_dps")}
    used |= {
        n.replace("deg", "rad"): col[n] * DEG for n in ("roll_deg", "pitch_deg", "yaw_deg", "pitch_acc_deg")
    }
    used |= {"speed_mps": col["odo_speed_mps"], "pressure_pa": col["pressure_hpa"] * 100}
    used["temperature_k"] = col["temperature_c"] + FREEZING_K
    position = {n: used[n][here] for n in GnssFix.columns()}
    tables: dict[str, SensorTable] = {
        "fix": GnssFix.assemble(time_s[here], notes.repaired, **position),
        "velocity": GnssVelocity.assemble(time_s[moving], **{n: c[moving] for n, c in velocity.items()}),
    }
    for name, kind in _OTHERS.items():
        tables[name] = kind.assemble(time_s, None, **{n: used[n] for n in kind.columns() if n in used})
    return tables


def _forget_placeholders(col: dict[str, Floats], notes: Notes) -> None:
    """Make numbers that stand for "unknown" unknown: phones write accuracies of 0 or -1, receivers 2^32 mm, and an
    attitude of exactly 0, 0, 0 until they are aligned. In place."""
    for name in ("h_acc_m", "v_acc_m", "s_acc_mps", "pitch_acc_deg"):
        senseless = (col[name] <= 0) | (col[name] > _WORST_ACCURACY)
        if senseless.any():
            col[name] = np.where(senseless, np.nan, col[name])
            notes.repaired[f"{name}: not above 0 or absurdly large, taken as unknown"] += int(senseless.sum())
    angles = np.array([col[name] for name in ("roll_deg", "pitch_deg", "yaw_deg")])
    asleep = np.isfinite(angles[1]) & np.all((angles == 0) | np.isnan(angles), axis=0)
    # A pitch column alone may well read 0 on a level road; only with roll or yaw beside it does 0 mean nothing.
    asleep &= np.isfinite(angles[[0, 2]]).any(axis=0)
    if asleep.any():
        for name in ("roll_deg", "pitch_deg", "yaw_deg"):
            col[name] = np.where(asleep, np.nan, col[name])
        notes.repaired["attitude of exactly 0, taken as unknown"] += int(asleep.sum())


_OTHERS: dict[str, type[SensorTable]] = {
    "force": SpecificForce,
    "rate": AngularRate,
    "attitude": Attitude,
    "odometry": Odometry,
    "pressure": Pressure,
}
