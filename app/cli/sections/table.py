"""A row of the table of sections."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.cli.sections.reading import NAMES, Section
from app.core.text import rounded
from app.map.heights.classes import CLASSES, ByClass

METRES_PER_MILE = 1609.344
DIGITS = 3
"""Of miles, as HPMS has them, and of shares."""


def row_of(section: Section, found: ByClass) -> dict[str, Any]:
    """Miles in each class, scaled to the section; a probability that is not known is None."""
    shares = np.append(found.length_m, found.whole_m - found.length_m.sum()) / found.whole_m
    # Rounded as sums, so that they add up to the section.
    sums = np.round(np.cumsum(shares) * section.miles, DIGITS)
    miles = [rounded(one, DIGITS) for one in np.diff(sums, prepend=0.0).tolist()]
    return {
        **dict(zip(NAMES, section.given, strict=True)),
        "section_miles": rounded(section.miles, DIGITS),
        "line_miles": rounded(found.whole_m / METRES_PER_MILE, DIGITS),
        **dict(zip([*(f"grades_{name}" for name in CLASSES), "unmeasured_miles"], miles, strict=True)),
        "measured_share": rounded(1 - float(shares[-1]), DIGITS),
        "class_probability": rounded(found.sure, DIGITS),
    }
