"""Roads for tests that are about something else: imported in the caller's transaction, with heights as a test wants."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
from sqlalchemy.orm import Session

from app.roads.copy import copy_roads, forget_roads
from app.roads.documents import USUAL, ImportCounts, Source
from app.roads.imports import Import
from app.terrain.store import dem_version_id
from fusion.network.unknowns import knot_positions
from fusion.roads.table import RoadTable
from fusion.types import Floats, Progress, no_progress


def replace_roads(
    session: Session,
    table: RoadTable,
    source_name: str,
    sha256: str,
    progress: Progress = no_progress,
    *,
    dem_slope_percent: Floats | None = None,
    dem_heights_m: Floats | None = None,
    region: str = "roads",
) -> ImportCounts:
    """Make ``table`` a region in the caller's transaction, which keeps drives and solvers out until it ends.

    ``dem_slope_percent`` has shape (n,), ``dem_heights_m`` one height a knot (``knot_positions``), NaN unknown; None:
    unknown everywhere. Losses need no acceptance.
    """
    slope = np.full(len(table), np.nan) if dem_slope_percent is None else dem_slope_percent
    heights = np.full(len(knot_positions(table)[0]), np.nan) if dem_heights_m is None else dem_heights_m
    copy_roads(session, table, slope, heights, progress)
    source = Source(source_name, sha256, region)
    work = Import(table, source, USUAL, progress, lambda: nullcontext(session), dem_version_id(session))
    counts = work.compare(session)
    work.carry_out(counts)
    forget_roads(session)
    return counts
