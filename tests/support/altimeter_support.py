"""A log of a bicycle computer: positions, and heights of an altimeter that is late."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from fusion.simulate.drive import SimulatedDrive

STEP_M = 0.2
DAY_S = 86_400


def altimeter_gpx(drive: SimulatedDrive, late_s: float, after_s: float = DAY_S) -> str:
    """The drive as GPX, so much later, its heights late by ``late_s``."""
    lon, lat = drive.lonlat()
    heights = np.interp(drive.elapsed_s - late_s, drive.elapsed_s, drive.gnss.alt_msl_m)
    points = "".join(
        f'<trkpt lat="{y:.7f}" lon="{x:.7f}"><ele>{STEP_M * round(h / STEP_M):.1f}</ele>'
        f"<time>{datetime.fromtimestamp(t + after_s, UTC).isoformat()}</time></trkpt>"
        for x, y, h, t in zip(lon, lat, heights, drive.time_s.round(2).tolist(), strict=True)
    )
    return f'<gpx version="1.1"><trk><trkseg>{points}</trkseg></trk></gpx>'
