"""Where each log is and how large its drive: read once, so that those of a place are worked on together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.batch.folder import BatchFolder, is_settled, key_of, write_table
from app.batch.listing import DIED, Log, opened, reason_of
from app.batch.places import cells, place_of_cell
from app.core.mirror import sha256_of
from fusion.formats import read_log
from fusion.formats.archives.look import Kind, Looker
from fusion.types import DriveLog

LOGS_AT_ONCE, BYTES_AT_ONCE = 64, 256 << 20
"""Of one task. They do not depend on how many workers there are: so the same logs make the same files."""
GROUP_LOGS, GROUP_EPOCHS = 16, 100_000
"""Of a group that is fused by one task: seconds of work, and what a worker that dies loses."""
NOWHERE = -1
"""The cell of a log without positions of its own: raw signals, of which they are computed."""
SCHEMA = pa.schema(
    {
        "sha256": pa.string(),
        "cell": pa.int64(),
        "epochs": pa.int64(),
        "reason": pa.string(),
        "again": pa.bool_(),
    }
)


class Located(NamedTuple):
    """A log, what its bytes are, the cell of its middle, how many positions, and why it is not used (empty: it is).

    ``again``: that is to be looked at another time.
    """

    log: Log
    sha256: str
    cell: int
    epochs: int
    reason: str
    again: bool


@dataclass(frozen=True)
class Chunk:
    """Logs that one task looks at; ``columns`` as readers of logs take them, ``sports`` as ``Looker`` does."""

    folder: BatchFolder
    key: str
    logs: tuple[Log, ...]
    columns: dict[str, str]
    sports: tuple[str, ...] | None = None

    @property
    def is_done(self) -> bool:
        """Whether that is known from before."""
        return is_settled(self.folder.located(self.key))

    def work(self, without: frozenset[int] = frozenset()) -> None:
        """Look at each log but those whose numbers are in ``without``, which kill whoever does."""
        found = [
            _looked_at(log, self.columns, self.sports) for k, log in enumerate(self.logs) if k not in without
        ]
        for k in sorted(without):
            found.insert(k, ("", NOWHERE, 0, *DIED))
        names = SCHEMA.names
        columns = {name: [one[k] for one in found] for k, name in enumerate(names)}
        write_table(self.folder.located(self.key), pa.table(columns, schema=SCHEMA))

    def alone(self, k: int) -> None:
        """Look at one log and keep nothing: whether it kills."""
        _looked_at(self.logs[k], self.columns, self.sports)

    def found(self) -> list[Located]:
        """What was found."""
        rows = pq.read_table(self.folder.located(self.key)).to_pylist()
        return [Located(log, **row) for log, row in zip(self.logs, rows, strict=True)]


def chunks(
    folder: BatchFolder,
    logs: Sequence[Log],
    columns: dict[str, str],
    version: str,
    sports: tuple[str, ...] | None = None,
) -> list[Chunk]:
    """The logs in runs, in their order."""
    runs: list[list[Log]] = []
    size = 0
    for log in logs:
        size += log.size
        if not runs or len(runs[-1]) == LOGS_AT_ONCE or size > BYTES_AT_ONCE:
            runs.append([])
            size = log.size
        runs[-1].append(log)
    chosen = (version, columns) if sports is None else (version, columns, sports)
    return [Chunk(folder, key_of(*chosen, run), tuple(run), columns, sports) for run in runs]


def groups(located: Sequence[Located]) -> list[list[Located]]:
    """Logs that can be used, by place; in a place in the order of cells, and of names in these."""
    runs: list[list[Located]] = []
    epochs, last = 0, None
    for one in sorted(located, key=lambda one: (one.cell, one.log)):
        place = None if one.cell == NOWHERE else int(place_of_cell(np.array(one.cell)))
        epochs += one.epochs
        if not runs or place != last or len(runs[-1]) == GROUP_LOGS or epochs > GROUP_EPOCHS:
            runs.append([])
            epochs = one.epochs
        runs[-1].append(one)
        last = place
    return runs


def _looked_at(
    log: Log, columns: dict[str, str], sports: tuple[str, ...] | None
) -> tuple[str, int, int, str, bool]:
    try:
        with opened(log) as path:
            sha256 = sha256_of(path)
            if sports is not None and (other := _other_sport(path, sports)):
                return sha256, NOWHERE, 0, other, False
            try:
                return sha256, *_middle(read_log(path, columns=columns)), "", False
            except Exception as error:
                return sha256, NOWHERE, 0, *reason_of(error)
    except Exception as error:  # any storage fsspec knows, each with errors of its own
        return "", NOWHERE, 0, *reason_of(error)


def _other_sport(path: Path, sports: tuple[str, ...]) -> str:
    """Why a log is not wanted that tells of another sport; empty where it is."""
    with path.open("rb") as file:
        looked = Looker(sports).look(file, path.name)
    return looked.reason if looked.kind is Kind.NOT_ON_ROADS else ""


def _middle(log: DriveLog) -> tuple[int, int]:
    """The cell and the number of positions."""
    fix: Any = log.fix
    known = np.isfinite(fix.lon_deg) & np.isfinite(fix.lat_deg)
    if not known.any():
        return NOWHERE, 0 if log.raw is None else len(log.raw.signals)
    middle = [np.median(v[known], keepdims=True) for v in (fix.lon_deg, fix.lat_deg)]
    return int(cells(*middle)[0]), int(np.count_nonzero(known))
