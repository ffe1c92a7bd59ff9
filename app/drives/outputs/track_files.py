"""A drive's estimated track as CSV and as GPX, for other programs and for another upload. Knows no database."""

from __future__ import annotations

import re
from collections.abc import Iterator
from xml.sax.saxutils import escape

import numpy as np

from app.core.text import COORDINATE_DIGITS, LENGTH_DIGITS
from app.drives.outputs.columns import csv_chunks, numbers, time_texts
from fusion.terrain.datum import ELLIPSOID
from fusion.types import PAUSE_S, Floats, Ints, Track

TIME_DIGITS, SPEED_DIGITS, ANGLE_DIGITS = 3, 3, 3
_NO_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no way to write."""

_HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<gpx version="1.1" creator="Versant" xmlns="http://www.topografix.com/GPX/1/1"'
    ' xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"'
    ' xsi:schemaLocation="http://www.topografix.com/GPX/1/1 http://www.topografix.com/GPX/1/1/gpx.xsd">\n'
)


def track_csv(track: Track, height_datum: str | None) -> Iterator[str]:
    """The track in the columns of a Versant CSV, so that it can be uploaded again; an empty cell is unknown.

    Rows without a place are left out. Heights stand in ``height_ell_m`` where they are above the ellipsoid, else in
    ``alt_msl_m``; they are the road's.
    """
    keep = _placed(track)

    def column(values: Floats, digits: int) -> list[float | None]:
        return numbers(values[keep], digits)

    height = "height_ell_m" if height_datum == ELLIPSOID else "alt_msl_m"
    return csv_chunks(
        {
            "time_s": column(track.time_s, TIME_DIGITS),
            "lat_deg": column(track.lat_deg, COORDINATE_DIGITS),
            "lon_deg": column(track.lon_deg, COORDINATE_DIGITS),
            height: column(track.alt_m, LENGTH_DIGITS),
            "h_acc_m": column(track.h_sigma_m, LENGTH_DIGITS),
            "v_acc_m": column(track.alt_sigma_m, LENGTH_DIGITS),
            "speed_mps": column(track.speed_mps, SPEED_DIGITS),
            "heading_deg": column(np.degrees(track.heading_rad) % 360, ANGLE_DIGITS),
            "pitch_deg": column(np.degrees(track.pitch_rad), ANGLE_DIGITS),
            "pitch_acc_deg": column(np.degrees(track.pitch_sigma_rad), ANGLE_DIGITS),
        }
    )


def track_gpx(track: Track, name: str, height_words: str) -> Iterator[str]:
    """The track as GPX 1.1: one segment for each uninterrupted stretch, a time and a height at each point.

    Elements stand in the order that the schema wants. ``height_words`` says what heights refer to.
    """
    keep = _placed(track)
    title, words = _text(name), _text(height_words)
    times = time_texts(track.time_s[keep])
    begin = f"<time>{times[0]}</time>" if times else ""
    yield (
        f"{_HEAD}<metadata><name>{title}</name><desc>{words}</desc>{begin}</metadata>\n"
        f"<trk><name>{title}</name>\n"
    )
    columns = (
        numbers(track.lat_deg[keep], COORDINATE_DIGITS),
        numbers(track.lon_deg[keep], COORDINATE_DIGITS),
        numbers(track.alt_m[keep], LENGTH_DIGITS),
        times,
    )
    starts = (np.diff(track.time_s[keep], prepend=-np.inf) > PAUSE_S) | track.after_outage[keep]
    for number, point in enumerate(zip(*columns, starts.tolist(), strict=True)):
        yield _point(number, *point)
    yield ("</trkseg>\n" if times else "") + "</trk>\n</gpx>\n"


def _point(
    number: int, lat: float | None, lon: float | None, height: float | None, time: str | None, starts: bool
) -> str:
    before = ("</trkseg>\n<trkseg>\n" if number else "<trkseg>\n") if starts or not number else ""
    ele = "" if height is None else f"<ele>{height}</ele>"
    return f'{before}<trkpt lat="{lat:.7f}" lon="{lon:.7f}">{ele}<time>{time}</time></trkpt>\n'


def _placed(track: Track) -> Ints:
    """The epochs of which a place and a time are known."""
    placed = np.isfinite(track.lat_deg) & np.isfinite(track.lon_deg) & np.isfinite(track.time_s)
    return np.flatnonzero(placed)


def _text(words: str) -> str:
    """Words that somebody else wrote, as the text of an element."""
    return escape(_NO_XML.sub("\ufffd", words))
