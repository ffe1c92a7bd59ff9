"""Settles the network: solves each cell anew in a wide subnetwork, from stored passes alone, in any order.

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
from app.core.messages import say
from app.core.telemetry.measures import SWAP_CONFLICTS
from app.network.cells import (
    beside,
    cells_over,
    make_due,
    take_due,
    take_unsettled,
    unsettle,
    versions_of,
)
from app.network.locks import cell_claim
from app.network.solve import settle_cell
from app.network.swap import BusyError, Proposal, condense_old_passes, log_solution, snapshot, swap
from fusion.types import Progress, no_progress

_WAIT_S = 0.1
_TRIES = 100
_MARKED_AT_ONCE = 1000

# Slopes are renewed where they are and where they should be: those without evidence must go. Of the passes over a
# segment one is read, however many there are.
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
_CELLS = text(f"""
    WITH driven AS MATERIALIZED ({_DRIVEN.format(where="")})
    SELECT s.cell, count(*) FILTER (WHERE n.segment_id IS NOT NULL) AS in_network
    FROM ({_PUBLISHED.format(of_cell="")} UNION SELECT segment_id FROM driven) AS p
    JOIN segments AS s ON s.id = p.segment_id
    LEFT JOIN ({_IN_NETWORK.format(driven="SELECT segment_id FROM driven", of_cell="")}) AS n
        ON n.segment_id = p.segment_id
    GROUP BY s.cell ORDER BY s.cell
""")  # noqa: S608 - constants
_IN_NETWORK_OF_CELL = text(
    _IN_NETWORK.format(driven=_DRIVEN.format(where="WHERE s.cell = :cell"), of_cell=_OF_CELL)
)
_PUBLISHED_OF_CELL = text(_PUBLISHED.format(of_cell=_OF_CELL))


def settle_network(
    sessions: Sessions,
    progress: Progress = no_progress,
    *,
    after_cell: int = -1,
    note_done: Callable[[int], None] = lambda _: None,
) -> int:
    """Renew slopes and aggregates cell by cell; returns the number of segments of the network.

    Drives may come and go meanwhile, and an interrupted run leaves a correct network. To continue one, pass the last
    cell that ``note_done`` was called with as ``after_cell``.
    """
    with sessions() as session:
        rows = session.execute(_CELLS).all()
    for done, row in enumerate(rows):
        if row.cell <= after_cell:
            continue
        progress("slopes", done / len(rows))
        _settle(sessions, row.cell)
        note_done(row.cell)
    progress("slopes", 1.0)
    return sum(row.in_network for row in rows)


def settle_about(sessions: Sessions, segment_ids: Collection[int], progress: Progress = no_progress) -> None:
    """Settle the cells in which these segments are shown, and those beside them."""
    with sessions() as session:
        middle = cells_over(session, segment_ids)
        about = sorted(versions_of(session, {*middle, *(near for cell in middle for near in beside(cell))}))
    for done, cell in enumerate(about):
        progress("slopes", done / len(about))
        _settle(sessions, cell)


def settle_due(sessions: Sessions, age_s: float) -> bool:
    """Settle the cell that has waited longest, if it has waited for ``age_s``; whether there was one."""
    with sessions.begin() as session:
        cell = take_due(session, age_s)
    if cell is None:
        return False
    _settle_taken(sessions, cell)
    return True


def leave_to_workers(sessions: Sessions, age_s: float) -> int:
    """Have every cell of the network wait as if it had for ``age_s``: the workers of all machines settle them side by
    side, while no drive waits. How many there are."""
    with sessions() as session:
        cells = [row.cell for row in session.execute(_CELLS)]
    for first in range(0, len(cells), _MARKED_AT_ONCE):
        with sessions.begin() as session:
            make_due(session, cells[first : first + _MARKED_AT_ONCE], age_s)
    return len(cells)


def _settle(sessions: Sessions, cell: int) -> None:
    with sessions.begin() as session:
        take_unsettled(session, [cell])
    _settle_taken(sessions, cell)


def _settle_taken(sessions: Sessions, cell: int) -> None:
    try:
        with cell_claim(sessions) as claim:
            for attempt in range(_TRIES):
                started_s = time.monotonic()
                if claim.take([cell]):
                    proposal = _propose(sessions, cell)
                    if swap(sessions, proposal, settled=True):
                        log_solution("settled", proposal, 1, time.monotonic() - started_s, attempt + 1)
                        condense_old_passes(sessions, proposal)
                        return
                    SWAP_CONFLICTS.count("settled")
                time.sleep(_WAIT_S)
        raise BusyError(say("cells.others", n=_TRIES))
    except Exception:
        with sessions.begin() as session:
            unsettle(session, [cell])
        raise


def _propose(sessions: Sessions, cell: int) -> Proposal:
    """Solve one cell from what is stored alone. Segments of other cells of the network are left to these."""
    with snapshot(sessions) as session:
        published = set(session.execute(_PUBLISHED_OF_CELL, {"cell": cell}).scalars())
        ids = session.execute(_IN_NETWORK_OF_CELL, {"cell": cell}).scalars().all()
        if not ids:
            return Proposal.of(session, [], published)
        solution = settle_cell(session, ids)
        around = solution.around
        others = np.unique(around.cell[around.driven | (around.drives >= 0)])
        shown = solution.subnetwork.published & ((around.cell == cell) | ~np.isin(around.cell, others))
        return Proposal.of(session, [], published, (solution, shown))
