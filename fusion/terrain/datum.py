"""What heights refer to, in words: those of a log, and those of a network that logs and an elevation model made."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from fusion.types import DriveLog

MEAN_SEA_LEVEL = "mean sea level as the receivers logged it"
"""Receivers subtract a geoid of their own: mostly EGM96 on a coarse grid, a metre or two off a country's datum."""
ELLIPSOID = "the WGS 84 ellipsoid"
STANDARD_ATMOSPHERE = "sea level of the standard atmosphere (by pressure alone: the day's weather is in it)"
CONTROL = "the datum of the control points"


def datum_of_log(log: DriveLog) -> str | None:
    """What the heights of a log refer to: of two datums the one that more fixes have, which methods use; None without.

    The choice is that of ``methods.profile.measurements`` and ``methods.epochs.table``.
    """
    level, ellipsoid = (
        int(np.isfinite(column).sum()) for column in (log.fix.alt_msl_m, log.fix.height_ell_m)
    )
    if level or ellipsoid:
        return MEAN_SEA_LEVEL if level >= ellipsoid else ELLIPSOID
    return STANDARD_ATMOSPHERE if len(log.pressure) else None


def datum_of_network(logs: Iterable[str | None], dem: str | None, control: bool = False) -> str | None:
    """What heights refer to that logs, an elevation model of datum ``dem`` and maybe control points give together.

    None where nothing has a height. Logs of several datums pull at each other, which is said.
    """
    known = {one for one in logs if one is not None}
    measured = sorted(known - {STANDARD_ATMOSPHERE})
    model = None if dem is None else f"the elevation model's datum ({dem})"
    if len(measured) > 1:
        datum = f"no single datum, for the logs differ: {', '.join(measured)}"
    else:
        datum = " and ".join([*measured, *([model] if model else [])])
    datum = datum or (STANDARD_ATMOSPHERE if known else "")
    if control:
        return f"{CONTROL} near these, elsewhere {datum}" if datum else CONTROL
    return datum or None
