"""Carries out a plan: in which order, in how large pieces, and with which lock. ``changing`` has what a step does.

A piece that owns the network keeps drives and solvers waiting, so it takes a tenth of a second, and a pause as long
follows it. Pieces grow and shrink with the time that the last one took.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from typing import Any, NamedTuple

import numpy as np
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
    pauses: bool = True
    _size: int = 200

    def do(self, work: Callable[[Session, Step], None], *, owns: bool) -> float:
        """One step in a transaction of its own; how long it had the network, s."""
        with self.transaction() as session:
            (own_network if owns else share_network)(session)
            begun = time.perf_counter()
            if dem_version_id(session) != self.dem_version:
                raise TerrainChangedError
            self.steps += 1
            work(session, Step(self.version, state_of(self.version, self.steps), self.region))
        held = time.perf_counter() - begun
        if owns:
            self.longest_hold_s = max(self.longest_hold_s, held)
            if self.pauses:
                time.sleep(held)
        return held

    def pieces(self, weights: Ints, *, owns: bool) -> Iterator[tuple[slice, Callable[[float], None]]]:
        """Parts of so many things in their order, and whom to tell how long each took; large where none waits."""
        start, total = 0, len(weights)
        before = np.concatenate([[0], np.cumsum(weights)])
        while start < total:
            heavy = int(np.searchsorted(before, before[start] + PASSES_AT_ONCE, side="right")) - 1
            size = self._size if owns else MOST
            end = min(start + size, max(heavy, start + 1), total)
            yield slice(start, end), partial(self._note, end - start)
            start = end

    def _note(self, count: int, held_s: float) -> None:
        size = count * HOLD_S / max(held_s, 1e-4)
        self._size = int(min(max(size, self._size / 2, LEAST), 2 * self._size, MOST))


class _Portion(NamedTuple):
    """What is done alike: the things, how many passes there are over each, and what to do with some of them."""

    stage: str
    owns: bool
    things: list[Any]
    passes: Ints | None
    do: Callable[[Session, Step, list[Any]], None]


def carry_out(run: Run, plan: Plan, passes: Ints) -> None:
    """Do all that the plan says; ``passes`` (m,) are how many there are over each of its segments."""
    for portion in _portions(plan, passes):
        if not portion.things:
            continue
        weights = np.zeros(len(portion.things), np.int64) if portion.passes is None else portion.passes
        run.progress(portion.stage, 0.0)
        for part, took in run.pieces(weights, owns=portion.owns):
            some = portion.things[part]
            held = run.do(partial(_do, portion, some), owns=portion.owns)
            if portion.owns:
                took(held)
            run.progress(portion.stage, part.stop / len(portion.things))


def _do(portion: _Portion, some: list[Any], session: Session, step: Step) -> None:
    portion.do(session, step, some)


def _portions(plan: Plan, passes: Ints) -> Iterator[_Portion]:
    """In this order: what comes is there before what it takes the place of goes."""
    back: dict[int, list[Return]] = {}
    for one in plan.returns:
        back.setdefault(one.n, []).append(one)
    returns = np.isin(plan.added, list(back))
    yield _Portion("adding", False, plan.added[~returns].tolist(), None, partial(_add, {}))
    yield _Portion("adding", True, plan.added[returns].tolist(), None, partial(_add, back))
    same = plan.of(Change.MOVED, Change.RENUMBERED, Change.REVERSED)
    yield _Portion("moving", True, same.tolist(), passes[same], partial(_carry, plan))
    far = plan.of(Change.FAR)
    yield _Portion("moving", True, far.tolist(), passes[far], partial(_move_away, plan, back))
    for courses in (False, True):
        rows = plan.renamed[(plan.renamed[:, 2] != 0) == courses]
        yield _Portion("renaming", False, rows.tolist(), None, partial(_rename, courses))
    gone = plan.of(Change.SPLIT, Change.MERGED, Change.DROPPED)
    yield _Portion("dropping", True, plan.ids[gone].tolist(), passes[gone], changing.drop)
    released = plan.ids[plan.of(Change.RELEASED)].tolist()
    yield _Portion("dropping", False, released, None, changing.release)


def _add(back: Mapping[int, Sequence[Return]], session: Session, step: Step, rows: list[int]) -> None:
    changing.add(session, step, rows, back)


def _carry(plan: Plan, session: Session, step: Step, at: list[int]) -> None:
    turned = (plan.change[at] == Change.REVERSED).tolist()
    changing.carry(session, step, plan.ids[at].tolist(), plan.n[at].tolist(), turned)


def _move_away(
    plan: Plan, back: Mapping[int, Sequence[Return]], session: Session, step: Step, at: list[int]
) -> None:
    changing.move_away(session, step, plan.ids[at].tolist(), plan.n[at].tolist(), back)


def _rename(courses: bool, session: Session, step: Step, rows: list[list[int]]) -> None:
    ids, n = ([row[k] for row in rows] for k in (0, 1))
    changing.rename(session, step, ids, n, courses=courses)
