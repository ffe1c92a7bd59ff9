"""The whole network settled: each cell solved in a wide window of stored passes, from nothing else, in any order.

What it makes is what the drives made one by one, to a tenth of a sigma, and the same whatever came first. It is wanted
in the background once drives have come and gone, after an elevation import, which changes no slope by itself, after a
change of the library's adjustment, and to be sure. No drive is read again: what each says stands.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection

import numpy as np
from sqlalchemy import text

from app.core.db import Sessions
from app.core.telemetry.measures import SWAP_CONFLICTS
from app.network.cells import beside, cells_over, take_unsettled, unsettle, unsettled, versions_of
from app.network.locks import cell_claims
from app.network.solve import settle_cell
from app.network.swap import (
    BusyError,
    Found,
    condense_old_passes,
    log_solution,
    shown_cells,
    snapshot,
    swap,
)
from fusion.types import Progress, no_progress

_WAIT_S = 0.1
_TRIES = 100

# Each stage is made anew wherever it is or ought to be: what lost its ground must go. Of the passes over a segment one
# is looked at, however many there were.
_DRIVEN = """
    SELECT s.id AS segment_id FROM segments AS s, LATERAL (
        SELECT FROM drive_passes WHERE segment_id = s.id AND partition = versant_partition(s.cell)
        ORDER BY entered_s LIMIT 1) AS any_pass
    {where}
"""
_IN_NETWORK = "{driven} UNION SELECT segment_id FROM network_slopes {of_cell}"
_PUBLISHED = """
    SELECT segment_id FROM network_slopes {of_cell} UNION SELECT segment_id FROM drive_segments {of_cell}
    UNION SELECT segment_id FROM segment_slopes {of_cell}
"""
_OF_CELL = "WHERE segment_id IN (SELECT id FROM segments WHERE cell = :cell)"
_CELLS = text(
    f"""
    WITH driven AS MATERIALIZED ({_DRIVEN.format(where="")})
    SELECT s.cell, count(*) FILTER (WHERE n.segment_id IS NOT NULL) AS in_network
    FROM ({_PUBLISHED.format(of_cell="")} UNION SELECT segment_id FROM driven) AS p
    JOIN segments AS s ON s.id = p.segment_id
    LEFT JOIN ({_IN_NETWORK.format(driven="SELECT segment_id FROM driven", of_cell="")}) AS n
        ON n.segment_id = p.segment_id
    GROUP BY s.cell ORDER BY s.cell
    """  # noqa: S608 - constants
)
_IN_NETWORK_OF_CELL = text(
    _IN_NETWORK.format(driven=_DRIVEN.format(where="WHERE s.cell = :cell"), of_cell=_OF_CELL)
)
_PUBLISHED_OF_CELL = text(_PUBLISHED.format(of_cell=_OF_CELL))


def settle_network(
    sessions: Sessions,
    progress: Progress = no_progress,
    *,
    after_cell: int = -1,
    told: Callable[[int], None] = lambda _: None,
) -> int:
    """Make slopes and aggregates anew, cell by cell; returns the number of segments of the network.

    Drives come and go meanwhile, and one that is cut off leaves a network that is right throughout. Run it again to go
    on; with ``after_cell``, the last cell that ``told`` heard of, it goes on there.
    """
    with sessions() as session:
        cells = session.execute(_CELLS).all()
    for done, cell in enumerate(cells):
        if cell.cell <= after_cell:
            continue
        progress("slopes", done / len(cells))
        _settle(sessions, cell.cell)
        told(cell.cell)
    progress("slopes", 1.0)
    return sum(cell.in_network for cell in cells)


def settle_about(sessions: Sessions, segment_ids: Collection[int], progress: Progress = no_progress) -> None:
    """Settle the cells in which these segments are shown, and those beside them."""
    with sessions() as session:
        middle = cells_over(session, segment_ids)
        about = sorted(versions_of(session, {*middle, *(near for cell in middle for near in beside(cell))}))
    for done, cell in enumerate(about):
        progress("slopes", done / len(about))
        _settle(sessions, cell)


def settle_due(sessions: Sessions, age_s: float) -> bool:
    """Settle the cell that has waited longest of those that have for ``age_s``; whether there was one."""
    with sessions() as session:
        due = unsettled(session, age_s, 1)
    for cell in due:
        _settle(sessions, cell)
    return bool(due)


def _settle(sessions: Sessions, cell: int) -> None:
    with sessions.begin() as session:
        take_unsettled(session, [cell])
    try:
        with cell_claims(sessions) as claims:
            for attempt in range(_TRIES):
                started_s = time.monotonic()
                if claims.take(cell):
                    found = _find(sessions, cell)
                    if swap(sessions, found, 0.0, settled=True):
                        log_solution("settled", found, 1, time.monotonic() - started_s, attempt + 1)
                        condense_old_passes(sessions, found)
                        return
                    SWAP_CONFLICTS.count("settled")
                time.sleep(_WAIT_S)
        raise BusyError(f"{_TRIES} times others were at work in the same cell")
    except Exception:
        with sessions.begin() as session:
            unsettle(session, [cell])
        raise


def _find(sessions: Sessions, cell: int) -> Found:
    """One cell, from what is stored alone. What lies in another cell of the network is left to that."""
    with snapshot(sessions) as session:
        published = set(session.execute(_PUBLISHED_OF_CELL, {"cell": cell}).scalars())
        ids = session.execute(_IN_NETWORK_OF_CELL, {"cell": cell}).scalars().all()
        if not ids:
            versions = versions_of(session, cells_over(session, published))
            return Found([], published, None, np.zeros(0, bool), versions)
        solution = settle_cell(session, ids)
        around = solution.around
        others = np.unique(around.cell[around.driven | (around.drives >= 0)])
        shown = solution.window.published & ((around.cell == cell) | ~np.isin(around.cell, others))
        versions = shown_cells(session, solution, shown, published)
    return Found([], published, solution, shown, versions)
