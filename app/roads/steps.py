"""Carries out a plan: in which order, in how large pieces, and with which lock. ``changing`` has what a step does.

A piece that owns the network keeps drives and solvers waiting, so it takes a tenth of a second, and a pause as long
follows it. Pieces grow and shrink with the time that the last one took.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy.orm import Session

from app.network.cells import state_of
from app.network.locks import own_network, share_network
from app.roads import changing
from app.roads.changing import Step
from app.roads.comparing import Plan
from app.roads.retired import Return
from app.terrain.store import dem_version_id
from fusion.roads.changes import Change
from fusion.types import Ints, Progress

HOLD_S = 0.1
"""How long a piece that owns the network is to take."""
LEAST, MOST = 10, 5000
"""Segments in a piece."""
PASSES_AT_ONCE = 1000
"""Passes that are rewritten in a piece, unless one segment has more."""


class TerrainChangedError(Exception):
    """Elevation rasters came in meanwhile: what was copied has the heights of before."""


Transactions = Callable[[], AbstractContextManager[Session]]
"""Begins a transaction on the import's connection, which is committed at the end of the block."""


@dataclass
class Run:
    """One import: how it writes, how far it is, and how long it has kept others out."""

    transaction: Transactions
    version: int
    region: int
    begun_at: datetime
    dem_version: int
    progress: Progress
    steps: int = 0
    longest_hold_s: float = 0.0
    _size: int = 200

    def do(self, work: Callable[..., None], columns: Sequence[Sequence[Any]], *, owns: bool) -> None:
        """One step in a transaction of its own: ``work`` on some things, of which ``columns`` tell."""
        with self.transaction() as session:
            (own_network if owns else share_network)(session)
            begun = time.perf_counter()
            if dem_version_id(session) != self.dem_version:
                raise TerrainChangedError
            self.steps += 1
            work(session, Step(self.version, state_of(self.version, self.steps), self.region), *columns)
        held_s = time.perf_counter() - begun
        if owns:
            self.longest_hold_s = max(self.longest_hold_s, held_s)
            size = len(columns[0]) * HOLD_S / max(held_s, 1e-4)
            self._size = int(min(max(size, self._size / 2, LEAST), 2 * self._size, MOST))
            time.sleep(held_s)

    def pieces(self, weights: Ints, *, owns: bool) -> Iterator[slice]:
        """Parts of so many things in their order: as large as the last step allows, and large where none waits."""
        start, total = 0, len(weights)
        before = np.concatenate([[0], np.cumsum(weights)])
        while start < total:
            heavy = int(np.searchsorted(before, before[start] + PASSES_AT_ONCE, side="right")) - 1
            end = min(start + (self._size if owns else MOST), max(heavy, start + 1), total)
            yield slice(start, end)
            start = end


_Portion = tuple[str, bool, list[NDArray[Any]], Ints | None, Callable[..., None]]
"""What is done alike: the stage, whether it owns the network, columns that tell of the things, how many passes are over
each, and what to do."""


def carry_out(run: Run, plan: Plan, passes: Ints) -> None:
    """Do all that the plan says; ``passes`` (m,) are how many there are over each of its segments."""
    for stage, owns, columns, weights, do in _portions(plan, passes):
        total = len(columns[0])
        if not total:
            continue
        run.progress(stage, 0.0)
        for part in run.pieces(np.zeros(total, np.int64) if weights is None else weights, owns=owns):
            run.do(do, [column[part].tolist() for column in columns], owns=owns)
            run.progress(stage, part.stop / total)


def _portions(plan: Plan, passes: Ints) -> Iterator[_Portion]:
    """In this order: what comes is there before what it takes the place of goes."""
    back: dict[int, list[Return]] = {}
    for one in plan.returns:
        back.setdefault(one.n, []).append(one)
    returns = np.isin(plan.added, list(back))
    yield ("adding", False, [plan.added[~returns]], None, partial(changing.add, back={}))
    yield ("adding", True, [plan.added[returns]], None, partial(changing.add, back=back))
    same = plan.of(Change.MOVED, Change.RENUMBERED, Change.REVERSED)
    carried = [plan.ids[same], plan.n[same], plan.change[same] == Change.REVERSED]
    yield ("moving", True, carried, passes[same], changing.carry)
    far = plan.of(Change.FAR)
    moved = [plan.ids[far], plan.n[far]]
    yield ("moving", True, moved, passes[far], partial(changing.move_away, back=back))
    for courses in (False, True):
        rows = plan.renamed[(plan.renamed[:, 2] != 0) == courses]
        yield ("renaming", False, [*rows[:, :2].T], None, partial(changing.rename, courses=courses))
    gone = plan.of(Change.SPLIT, Change.MERGED, Change.DROPPED)
    yield ("dropping", True, [plan.ids[gone]], passes[gone], changing.drop)
    yield ("dropping", False, [plan.ids[plan.of(Change.RELEASED)]], None, changing.release)
