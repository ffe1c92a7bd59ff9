"""Logs that pages have something to say about, made out of a simulated one."""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Callable

from geoid_support import APART_M
from processing_support import HEADER

DAY_S = 86_400.0
FOOT_M = 0.3048
NAMES = {"time_s": "Timestamp", "lat_deg": "Latitude", "lon_deg": "Longitude", "alt_msl_m": "Altitude (ft)"}
"""By which another program calls its columns."""
Row = dict[str, str]


def rows_of(log: bytes) -> list[Row]:
    return list(csv.DictReader(io.StringIO(log.decode())))


def changed(log: bytes, day: int, change: Callable[[Row], Row] = dict, seconds: int = 75) -> bytes:
    """The first part of a log of one row a second, on another day, each row changed."""
    rows = rows_of(log)[:seconds]
    rows = [change(row | {"time_s": f"{float(row['time_s']) + day * DAY_S:.3f}"}) for row in rows]
    text = io.StringIO()
    out = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    out.writeheader()
    out.writerows(rows)
    return text.getvalue().encode()


def upside_down(row: Row) -> Row:
    """Uphill is downhill to every sensor."""
    turned = {name: f"{-float(row[name]):.4f}" for name in ("vel_d_mps", "pitch_deg") if row[name]}
    kept = {name: value for name, value in row.items() if not name.startswith("acc_")}
    return kept | {"alt_msl_m": f"{600 - float(row['alt_msl_m']):.2f}"} | turned


def elsewhere(row: Row) -> Row:
    return row | {"lat_deg": f"{float(row['lat_deg']) - 30:.7f}"}


def by_other_names(log: bytes) -> bytes:
    """A log by another program's names, with two columns of no use and its heights above the ellipsoid, in feet."""
    text = io.StringIO()
    out = csv.writer(text, lineterminator="\n")
    out.writerow([*NAMES.values(), "Pressure", "Comment"])
    for row in rows_of(log):
        feet = f"{(float(row['alt_msl_m']) + APART_M) / FOOT_M:.2f}" if row["alt_msl_m"] else ""
        out.writerow([row["time_s"], row["lat_deg"], row["lon_deg"], feet, 990, "x"])
    return text.getvalue().encode()


def zip_of(**files: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in files.items():
            archive.writestr(f"{name}.csv", content)
    return out.getvalue()


def ride(began_s: int, lat: float = 49.0) -> bytes:
    """Forty seconds northwards, where there are no roads."""
    rows = (b"%d,%.5f,8.4\n" % (1_600_000_000 + began_s + k, lat + 1e-4 * k) for k in range(40))
    return HEADER + b"".join(rows)


def rides(began_s: int = 0) -> dict[str, bytes]:
    """Four rides of which two go on one after the other, and a file that is none."""
    return {
        "monday": ride(began_s),
        "monday2": ride(began_s + 41, 49.004),
        "tuesday": ride(began_s + 90_000),
        "friday": ride(began_s + 400_000),
        "notes": b"hello there",
    }
