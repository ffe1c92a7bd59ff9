"""How evidence grows with the passes over one street: rows read, time to read and solve, bytes, and what sums change.

    PYTHONPATH=.:benchmarks python -m evidence [--most 1000] [--without 300] [--json FILE]

Made-up drives (``accuracy.adjustment_drives``: Doppler, pitch, force, altitudes, some barometers) along a street of two
kilometres and 25 segments, stored and solved in an embedded PostgreSQL as the service does it. At 10, 100, 300, 1,000
and 10,000 passes a segment, up to ``--most``: what a solution of the whole street reads and takes, with sums and, up to
``--without``, in a second database in which all passes are read; there also how far slopes and sigmas with sums are
from those without. At last bytes: of a pass in the table and each index, and of the log (WAL) for a pass that is
appended, one that is condensed, and a rejection. ``--recent`` tries another number of recent passes.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from sqlalchemy import text

from accuracy.adjustment_drives import Synthetic
from accuracy.arguments import parser_of
from accuracy.road_draws import PLANE, road_through
from accuracy.scoring import show_progress, text_table, write_json
from app.core.db import Sessions
from app.embedded.cluster import EmbeddedPostgres
from app.network import condensed, extracts, passes, solve, swap
from app.roads import imports as roads
from app.roads.documents import USUAL, Source
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable
from fusion.types import Ints
from service.adjustment import append
from service.databases import new_database, vacuum

STEPS = (10, 100, 300, 1_000, 10_000)
SEGMENTS, LENGTH_M = 25, 80.0

_SIZES = """
    SELECT kind, sum(bytes) FROM (
        SELECT CASE WHEN c.relkind = 'r' THEN 'table' ELSE p.relname END AS kind, pg_relation_size(c.oid) AS bytes
        FROM pg_class AS c LEFT JOIN pg_inherits AS i ON i.inhrelid = c.oid
        LEFT JOIN pg_class AS p ON p.oid = i.inhparent
        WHERE c.relname LIKE 'drive_passes_of_%' AND c.relkind IN ('r', 'i')
        UNION ALL
        SELECT 'table, out of line', pg_relation_size(reltoastrelid) FROM pg_class
        WHERE relname LIKE 'drive_passes_of_%' AND relkind = 'r'
    ) AS one GROUP BY kind ORDER BY kind
"""

STEP_COLUMNS = {
    "passes": ("passes a segment", "d"), "rows": ("rows read a segment", ".0f"), "kB": ("kB read", ".0f"),
    "read_s": ("read s", ".3f"), "solve_s": ("read and solve s", ".2f"), "without_rows": ("without sums: rows", ".0f"),
    "without_kB": ("kB", ".0f"), "without_solve_s": ("s", ".2f"), "moved_median": ("moved, sigmas: median", ".3f"),
    "moved_most": ("most", ".3f"), "sigma_least": ("sigma over theirs: least", ".3f"),
    "sigma_median": ("median", ".3f"), "sigma_most": ("most", ".3f"),
}  # fmt: skip
WRITTEN_COLUMNS = {"name": ("a pass", ""), "bytes": ("bytes of the log", ".0f"), "ms": ("ms", ".2f")}
STORED_COLUMNS = {"kind": ("stored, of a pass", ""), "bytes": ("bytes", ".0f")}


@dataclass
class Street:
    """A database with the street in it."""

    sessions: Sessions
    ids: Ints

    @classmethod
    def new(cls, sessions: Sessions, table: RoadTable) -> Street:
        """The street without a drive, in an empty database."""
        roads.bring_in(sessions, table, Source("street.osm", "0" * 64, "street"), Path("no-dem"), USUAL)
        with sessions() as session:
            return cls(sessions, extracts.all_roads(session)[1])

    def one(self, query: str) -> Any:
        """The one value of a query."""
        with self.sessions() as session:
            return session.execute(text(query)).scalar_one()

    def wal_bytes(self) -> int:
        """How much has been written to the log of all databases so far."""
        return int(self.one("SELECT pg_current_wal_insert_lsn() - '0/0'"))

    def solved(self) -> tuple[solve.Solution, dict[str, float]]:
        """A solution of the whole street, and what it took."""
        with swap.snapshot(self.sessions) as session:
            begin = time.perf_counter()
            read = passes.passes_over(session, self.ids.tolist())
            took_s = time.perf_counter() - begin
        with swap.snapshot(self.sessions) as session:
            begin = time.perf_counter()
            solution, _ = solve.solve_around(session, set(self.ids.tolist()))
            whole_s = time.perf_counter() - begin
        size = sum(len(p.factor.encode()) for p in read)
        return solution, {
            "rows": len(read) / SEGMENTS,
            "kB": size / 1e3,
            "read_s": took_s,
            "solve_s": whole_s,
        }


@dataclass
class Written:
    """Bytes of the log and seconds for so many passes."""

    wal: int = 0
    seconds: float = 0.0
    passes: int = 0

    @contextmanager
    def of(self, street: Street, passes: int) -> Iterator[None]:
        """What happens meanwhile is of so many passes."""
        wal, begin = street.wal_bytes(), time.perf_counter()
        yield
        self.seconds += time.perf_counter() - begin
        self.wal += street.wal_bytes() - wal
        self.passes += passes

    def row(self, name: str) -> dict[str, Any]:
        """Of a table: what one pass takes."""
        n = max(self.passes, 1)
        return {"name": name, "bytes": self.wal / n, "ms": 1000 * self.seconds / n}


def the_street() -> RoadTable:
    """Straight to the east, a way for each segment."""
    lon, lat = PLANE.to_lonlat(np.linspace(0.0, LENGTH_M * SEGMENTS, SEGMENTS + 1), np.zeros(SEGMENTS + 1))
    return road_through(lon, lat, np.arange(1, SEGMENTS + 1), np.arange(SEGMENTS + 1))


def drives_along(synthetic: Synthetic) -> Iterator[list[PassFactor]]:
    """One drive after the other, there and back by turns."""
    for number in count(1):
        yield synthetic.drive(list(range(SEGMENTS))[:: 1 if number % 2 else -1])


def summing(street: Street, summed: Written) -> Callable[[Sessions, swap.Proposal], None]:
    """``swap.condense_old_passes``, measured."""
    genuine = swap.condense_old_passes

    def measured(sessions: Sessions, evidence: swap.Proposal) -> None:
        before = int(street.one("SELECT count(*) FROM drive_passes WHERE condensed_weight IS NOT NULL"))
        wal, begin = street.wal_bytes(), time.perf_counter()
        genuine(sessions, evidence)
        summed.seconds += time.perf_counter() - begin
        summed.wal += street.wal_bytes() - wal
        summed.passes += int(
            street.one("SELECT count(*) FROM drive_passes WHERE condensed_weight IS NOT NULL")
        )
        summed.passes -= before

    return measured


def compared(condensed: solve.Solution, full: solve.Solution) -> dict[str, float]:
    """How far slopes with sums are from those without, in their sigmas, and sigmas over theirs."""
    one, reference = condensed.result, full.result
    assert one is not None  # noqa: S101 - the street is driven
    assert reference is not None  # noqa: S101
    moved = np.abs(one.slope_percent - reference.slope_percent) / reference.slope_sigma_percent
    share = one.slope_sigma_percent / reference.slope_sigma_percent
    return {
        "moved_median": float(np.median(moved)), "moved_most": float(moved.max()),
        "sigma_least": float(share.min()), "sigma_median": float(np.median(share)), "sigma_most": float(share.max()),
    }  # fmt: skip


def grown(
    street: Street, full: Street, synthetic: Synthetic, most: int, without: int
) -> tuple[list[dict[str, Any]], list[Written]]:
    """A row for each step; and what was written for passes that were appended and summed."""
    rows: list[dict[str, Any]] = []
    appended, summed = Written(), Written()
    source, stored = drives_along(synthetic), 0
    for step in (s for s in STEPS if s <= most):
        while stored < step:
            batch = [next(source) for _ in range(min(condensed.RECENT_PASSES, step - stored))]
            with appended.of(street, SEGMENTS * len(batch)):
                store(street, batch)
            with patch.object(swap, "condense_old_passes", summing(street, summed)):
                swap.solve_all_marked(street.sessions)
            if stored < without:
                store(full, batch)
            stored += len(batch)
            show_progress(f"{stored} of {most} passes a segment")
        vacuum(street.sessions)
        with_condensed, figures = street.solved()
        row: dict[str, Any] = {"passes": step, **figures}
        if step <= without:
            reference, figures = full.solved()
            row |= {f"without_{name}": value for name, value in figures.items()} | compared(
                with_condensed, reference
            )
        rows.append(row)
    return rows, [appended, summed]


def store(street: Street, batch: Sequence[Sequence[PassFactor]]) -> None:
    """Append drives as a worker does."""
    for factors in batch:
        append(street.sessions, street.ids, factors)


def rejections(street: Street) -> Written:
    """What turning rejections writes."""
    out = Written()
    with street.sessions() as session:
        read = passes.passes_over(session, street.ids.tolist())[:500]
    with out.of(street, len(read)), street.sessions.begin() as session:
        passes.set_accepted(session, [], read)
    return out


def sizes(street: Street) -> dict[str, float]:
    """Bytes of a stored pass by relation, and of what is stored beside."""
    vacuum(street.sessions)
    stored = int(street.one("SELECT count(*) FROM drive_passes"))
    with street.sessions() as session:
        out = {kind: float(size) / stored for kind, size in session.execute(text(_SIZES))}
    for table in ("drive_constants", "condensed_passes"):
        rows = max(int(street.one(f"SELECT count(*) FROM {table}")), 1)  # noqa: S608 - constants
        out[f"a row of {table}"] = float(street.one(f"SELECT pg_total_relation_size('{table}')")) / rows
    return out


def main() -> None:
    """Print the tables."""
    parser = parser_of(__doc__)
    parser.add_argument("--most", type=int, default=1000, help="passes over each segment")
    parser.add_argument("--without", type=int, default=300, help="up to so many also without sums")
    parser.add_argument("--recent", type=int, default=condensed.RECENT_PASSES)
    args = parser.parse_args()
    condensed.RECENT_PASSES = args.recent
    table = the_street()
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder)) as cluster,
        new_database(cluster, "sums") as summing_up,
        new_database(cluster, "every") as keeping_all,
    ):
        street, full = (Street.new(sessions, table) for sessions in (summing_up, keeping_all))
        rows, (appended, summed) = grown(street, full, Synthetic(table), args.most, args.without)
        turned, stored = rejections(street), sizes(street)
    written = {"appended": appended, "summed": summed, "rejection": turned}
    print(f"A street of {SEGMENTS} segments, {args.recent} recent passes; a solution of the whole street:")
    print(text_table(rows, STEP_COLUMNS), end="\n\n")
    print(text_table([one.row(name) for name, one in written.items()], WRITTEN_COLUMNS), end="\n\n")
    print(text_table([{"kind": kind, "bytes": size} for kind, size in stored.items()], STORED_COLUMNS))
    write_json(
        args.json, {"steps": rows, "written": {k: vars(v) for k, v in written.items()}, "stored": stored}
    )


if __name__ == "__main__":
    main()
