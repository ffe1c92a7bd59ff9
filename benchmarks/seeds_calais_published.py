"""What Al Assaad's thesis prints (tables 2.1 to 2.3, sections 2.4 and 3.5), and a sentence on each difference."""

from __future__ import annotations

from collections.abc import Mapping

Quantity = tuple[str, str, str]
"""Name, unit, what the thesis prints."""

_ALONE = ", beside GNSS alone"


def _axes(quantity: str, unit: str, std: tuple[str, ...], mean: tuple[str, ...] = ()) -> list[Quantity]:
    """Rows of standard deviations, each beside GNSS alone too, then of means, along east, north and up."""
    rows: list[Quantity] = []
    for axis, printed in zip("ENU", std, strict=True):
        rows += [(f"{quantity} {axis}, std{end}", unit, printed) for end in ("", _ALONE)]
    return rows + [
        (f"{quantity} {axis}, mean", unit, printed) for axis, printed in zip("ENU", mean, strict=False)
    ]


_ALTITUDE: list[Quantity] = [
    ("altitude, the filter's own sigma", "m", ""),
    ("altitude, best possible std", "m", ""),
]
_THREE_D: list[Quantity] = [
    ("3-D position error, std", "m", "0.90"),
    ("3-D position error, std" + _ALONE, "m", "0.90"),
    ("3-D position error, max", "m", "6"),
    ("3-D position error, max" + _ALONE, "m", "6"),
]
_MAP: list[Quantity] = [
    ("map-match rate", "%", "94.35"),
    ("matches on the segment driven", "%", ""),
    ("epochs resampled", "%", "57"),
    ("epochs resampled, threshold 0.1", "%", "57"),
]
_SLOPES: list[Quantity] = [
    ("segments with a slope", "", "46"),
    ("driven segments with a slope", "%", "about half"),
    ("most epochs on a segment", "", "25"),
    ("steepest slope down", "%", "-2.6"),
    ("steepest slope up", "%", "4.7"),
    ("slope error, RMS", "%", ""),
    ("slope errors within 1.96 sigma", "%", ""),
]

CHAPTER_2: list[Quantity] = [
    *_axes("acceleration", "m/s2", ("0.34", "0.32", "0.20"), ("0.013", "0.038", "-0.0021")),
    *_axes("velocity", "m/s", ("1.27", "0.94", "0.30"), ("0.069", "0.094", "-0.0046")),
    *_axes("position", "m", ("2.8", "1.9", "0.6"), ("0.24", "0.32", "-0.11")),
    *_ALTITUDE,
    *_THREE_D,
    ("yaw, std", "rad", "0.14"),
    ("yaw, mean", "rad", "0.010"),
    ("pitch, std", "rad", "0.05"),
    ("pitch, mean", "rad", "-0.0052"),
    *_MAP,
]
CHAPTER_3: list[Quantity] = [
    *_axes("acceleration", "m/s2", ("-", "-", "-")),
    *_axes("velocity", "m/s", ("-", "-", "-")),
    *_axes("position", "m", ("-", "-", "0.30")),
    ("position U, std, receiver m8", "m", "0.30"),
    ("position U, std, receiver m8" + _ALONE, "m", "0.30"),
    *_ALTITUDE,
    ("altitude, best possible std, receiver m8", "m", ""),
    ("yaw, std", "rad", "-"),
    ("pitch, std", "rad", "0.05 (ch. 2)"),
    ("map-match rate", "%", "94.35 (ch. 2)"),
    *_MAP[1:3],
    *_SLOPES,
]
UNSCENTED: list[Quantity] = [
    *_axes("velocity", "m/s", ("-", "-", "-")),
    *_axes("position", "m", ("-", "-", "-")),
    ("yaw, std", "rad", "-"),
    ("pitch, std", "rad", "-"),
    ("map-match rate", "%", "-"),
    _MAP[1],
    *_SLOPES,
]

NOTES: Mapping[tuple[str, str], str] = {}
