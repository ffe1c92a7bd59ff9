"""All drives as one network, from files: the steps of ``fusion.together``, the network's equations block by block."""

from __future__ import annotations

import pickle
import shutil
from collections.abc import Callable, Mapping, Sequence, Set
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow.parquet as pq

from app.batch.folder import BatchError, BatchFolder, written
from app.batch.fusing import Choices, Group, Late, late_passes
from app.batch.hands import DEAD, Counted, Hands
from app.batch.listing import DIED, Log
from app.batch.places import place_of_cell
from app.batch.stored import cells_of, factors_of, passes_file, passes_in
from fusion.lags import next_lag
from fusion.network.adjust import adjust_from, tasks_of
from fusion.network.blockwise.owners import grouped
from fusion.network.blockwise.partition import bisected
from fusion.network.control import ControlHeights
from fusion.network.pass_factor import PassFactor
from fusion.network.segment_slopes import Adjustment
from fusion.network.terrain import Terrain
from fusion.roads.table import RoadTable
from fusion.types import Bools, Ints

MOST_SEGMENTS = 4000
"""Of a block."""


class StoredDrive(NamedTuple):
    """A drive by its group and its place in it. ``lag_s``: how late its altimeter was taken for, where it has one."""

    group: int
    place: int
    lag_s: float | None


@dataclass(frozen=True)
class StoredPasses:
    """The passes of a solution, read by whoever works on a block (``PassSource``)."""

    folder: BatchFolder
    round: Path

    def passes(self, block: int) -> Mapping[int, Sequence[PassFactor]]:
        """Those of a block, by the drives' places in the order of driving."""
        own: _Block = pickle.loads((self.round / f"passes-{block}").read_bytes())  # noqa: S301 - our own files
        counted = _counted(self.round)
        drives: dict[int, list[PassFactor]] = {}
        for place, cells in own.cells:
            for group in counted.groups_in[place]:
                file = passes_file(self.folder, place, counted.keys[group])
                table = pq.read_table(
                    file, filters=[("cell", "in", cells)], partitioning=None, use_threads=False
                )
                drive = counted.number[group][table["drive"].to_numpy()]
                mine, segment = _of_block(table["row"].to_numpy(), own)
                mine &= drive >= 0
                _add(drives, drive[mine], factors_of(table.filter(mine), segment[mine]), counted.widening)
        for number, file_name in own.late:
            stored, rows = late_passes(self.folder, file_name)
            mine, segment = _of_block(rows, own)
            told = [(*stored[k], int(segment[k])) for k in np.flatnonzero(mine).tolist()]
            over = PassFactor.decode_all([(data, at, sequence) for sequence, data, at in told])
            _add(drives, np.full(len(over), number), over, counted.widening)
        return drives


@dataclass(frozen=True, eq=False)
class _Block:
    """Rows (n,) of the file of roads, ascending, and the numbers of these segments in the network; the cells that they
    lie in by places; and the files of drives that were made anew, with their numbers."""

    rows: Ints
    segment: Ints
    cells: list[tuple[int, list[int]]]
    late: list[tuple[int, str]]


@dataclass(frozen=True, eq=False)
class _Counted:
    """Which drives count: by group the number of each, -1 for none; how much wider each is; which groups have passes in
    each place."""

    keys: list[str]
    number: list[Ints]
    widening: list[float]
    groups_in: dict[int, list[int]]


class _Remade(NamedTuple):
    """A drive that was made anew: for which lag, the file of its passes, and the rows that they count in."""

    lag_s: float
    file: str
    rows: Ints


@dataclass
class StoredEvidence:
    """``fusion.together.Evidence`` of drives whose passes are in files.

    ``row`` is the row in the file of roads of each segment of those that are solved; ``key`` names all that has part in
    the solution: another run with it goes on from the last step of this one. ``count`` makes bars of pieces of work.
    """

    hands: Hands
    folder: BatchFolder
    groups: Sequence[Group]
    drives: Sequence[StoredDrive]
    row: Ints
    choices: Choices
    key: str
    count: Callable[[str, int], Callable[[int], None]]
    _lag_s: dict[int, float] = field(default_factory=dict)
    _late: dict[int, _Remade] = field(default_factory=dict)
    _step: int = 0

    def __post_init__(self) -> None:
        self._lag_s = {k: one.lag_s for k, one in enumerate(self.drives) if one.lag_s is not None}
        scratch = self.folder.scratch
        if not (scratch / self.key).is_file():
            shutil.rmtree(scratch, ignore_errors=True)
            scratch.mkdir()
            (scratch / self.key).touch()

    def near(self, numbers: Sequence[int]) -> Ints:
        """All roads that are there: those around drives that do not count have no part."""
        return np.arange(len(self.row))

    def adjusted(
        self,
        network: RoadTable,
        rows: Ints,
        widening: Mapping[int, float],
        terrain: Terrain | None,
        control: ControlHeights,
    ) -> Adjustment:
        """See ``Evidence``."""
        place = self.folder.scratch / f"step-{self._step}"
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        blocks = replace(bisected(network, MOST_SEGMENTS, folder=place), hands=self.hands.count)
        bar = self.count(f"network, solution {self._step + 1}", tasks_of(blocks))
        self._tell(place, network, self.row[rows], blocks.block, widening)
        blocks = replace(blocks, executor=Counted(self.hands.executor, bar))
        found = adjust_from(StoredPasses(self.folder, place), network, blocks, terrain, control)
        shutil.rmtree(place)
        return found

    @property
    def altimeters(self) -> Set[int]:
        """See ``Evidence``."""
        return self._lag_s.keys()

    def made_anew(self, lag_s: Mapping[int, float], settled_s: float) -> Set[int]:
        """See ``Evidence``: their logs are fused again."""
        late = [
            Late(self._log(k), k, next_s, self.choices, self.folder, f"late-{k}-{self._step}")
            for k, one in lag_s.items()
            if k in self._lag_s and (next_s := next_lag(self._lag_s[k], one, settled_s)) is not None
        ]
        bar, made = self.count(f"late altimeters, step {self._step + 1}", len(late)), dict[int, _Remade]()
        for one, rows in self.hands.results(late, lambda one: (one.work,)):
            if rows is DEAD:
                raise BatchError(f"{one.log.name}: {DIED.text}")
            made[one.drive] = _Remade(one.lag_s, one.file, rows)
            bar(1)
        with written(self._made) as partial:
            partial.write_bytes(pickle.dumps(made))
        return self._take(made)

    def made_before(self) -> Set[int] | None:
        """See ``Evidence``."""
        if not self._made.is_file():
            return None
        return self._take(pickle.loads(self._made.read_bytes()))  # noqa: S301 - our own files

    @property
    def _made(self) -> Path:
        return self.folder.scratch / f"made-{self._step}"

    def _take(self, made: Mapping[int, _Remade]) -> Set[int]:
        self._step += 1
        self._late |= made
        self._lag_s |= {k: one.lag_s for k, one in made.items()}
        return made.keys()

    def _log(self, k: int) -> Log:
        drive = self.drives[k]
        return self.groups[drive.group].logs[drive.place]

    def _tell(
        self, place: Path, network: RoadTable, rows: Ints, block: Ints, widening: Mapping[int, float]
    ) -> None:
        """Leave for those who work on blocks what they have to know."""
        number = [np.full(len(one.logs), -1, np.int64) for one in self.groups]
        for at, k in enumerate(widening):
            if k not in self._late:
                number[self.drives[k].group][self.drives[k].place] = at
        cells = cells_of(network)
        keys = [one.key for one in self.groups]
        counted = _Counted(
            keys, number, [*widening.values()], self._groups_in(np.unique(place_of_cell(cells)))
        )
        (place / COUNTED).write_bytes(pickle.dumps(counted))
        late: dict[int, list[tuple[int, str]]] = {}
        for at, k in enumerate(widening):
            if k in self._late:
                passed = self._late[k].rows
                own = np.searchsorted(rows, passed)
                there = rows[np.minimum(own, len(rows) - 1)] == passed
                for number_of_block in np.unique(block[own[there]]).tolist():
                    late.setdefault(number_of_block, []).append((at, self._late[k].file))
        for number_of_block, mine in grouped(block):
            of_place = grouped(place_of_cell(cells[mine]))
            found = [(one, np.unique(cells[mine][where]).tolist()) for one, where in of_place]
            told = _Block(rows[mine], mine, found, late.get(number_of_block, []))
            (place / f"passes-{number_of_block}").write_bytes(pickle.dumps(told))

    def _groups_in(self, places: Ints) -> dict[int, list[int]]:
        number = {one.key: k for k, one in enumerate(self.groups)}
        return {
            place: sorted(number[file.stem] for file in passes_in(self.folder, place) if file.stem in number)
            for place in places.tolist()
        }


COUNTED = "counted"


@lru_cache(1)
def _counted(folder: Path) -> _Counted:
    return pickle.loads((folder / COUNTED).read_bytes())  # type: ignore[no-any-return] # noqa: S301 - our own files


def _add(
    drives: dict[int, list[PassFactor]], drive: Ints, factors: Sequence[PassFactor], widening: Sequence[float]
) -> None:
    for number, factor in zip(drive.tolist(), factors, strict=True):
        drives.setdefault(number, []).append(factor.widened(widening[number]))


def _of_block(rows: Ints, block: _Block) -> tuple[Bools, Ints]:
    """Which of these rows are the block's, and the numbers of their segments in the network."""
    at = np.minimum(np.searchsorted(block.rows, rows), len(block.rows) - 1)
    return block.rows[at] == rows, block.segment[at]
