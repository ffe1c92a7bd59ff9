"""What processes count and time besides requests, all of it in one table: the API shows it without loading who counts.

A worker answers no scrapes: it tallies in memory, and writes its totals into a row of its own every few seconds
(``ledger``), which ``/metrics`` adds up over all processes there have been.
"""

from __future__ import annotations

import json
import threading
import time
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

SHORT_S = (0.001, 0.005, 0.02, 0.1, 0.5, 2.0, 10.0, 60.0)
"""Upper ends of a histogram's buckets: waits for locks, statements."""
LONG_S = (0.1, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 300.0, 1800.0)
"""Computations."""
DIGITS = 6
"""Of what is stored: sums of decimal fractions stay what they are, so that no counter ever falls by a rounding."""

Totals = dict[str, float]
"""By the name of a measure, its labels and the part of it, as a list in JSON."""

_SUM = "sum"
_totals: Totals = defaultdict(float)
_lock = threading.Lock()


@dataclass(frozen=True)
class Measure:
    """A counter, or with ``buckets`` a histogram of seconds; under its name in ``/metrics``."""

    name: str
    meaning: str
    labels: tuple[str, ...] = ()
    buckets: tuple[float, ...] = ()

    def count(self, *values: str, by: float = 1.0) -> None:
        """Count ``by`` more with these labels."""
        self._add({"": by}, values)

    def observe(self, seconds: float, *values: str) -> None:
        """Note one duration with these labels."""
        bucket = bisect_left(self.buckets, seconds)
        self._add({str(bucket): 1.0, _SUM: max(seconds, 0.0)}, values)

    @contextmanager
    def timed(self, *values: str) -> Iterator[None]:
        """Note how long the block takes, however it ends."""
        started = time.monotonic()
        try:
            yield
        finally:
            self.observe(time.monotonic() - started, *values)

    def series(self, totals: Mapping[str, float]) -> dict[tuple[str, ...], dict[str, float]]:
        """The parts of each combination of labels that was counted."""
        series: dict[tuple[str, ...], dict[str, float]] = {}
        for key, total in sorted(totals.items()):
            name, *values, part = json.loads(key)
            if name == self.name and len(values) == len(self.labels):
                series.setdefault(tuple(values), {})[part] = total
        return series

    def cumulative(self, parts: Mapping[str, float]) -> tuple[list[tuple[str, float]], float]:
        """A histogram's buckets as Prometheus has them, each with all below it; and the sum of the durations."""
        count, shown = 0.0, []
        for number, end in enumerate((*self.buckets, float("inf"))):
            count += parts.get(str(number), 0.0)
            shown.append(("+Inf" if end == float("inf") else str(end), count))
        return shown, parts.get(_SUM, 0.0)

    def _add(self, parts: Mapping[str, float], values: tuple[str, ...]) -> None:
        if len(values) != len(self.labels):
            raise ValueError(f"{self.name} has the labels {self.labels}")
        with _lock:
            for part, by in parts.items():
                _totals[json.dumps([self.name, *values, part])] += by


def totals_now() -> Totals:
    """What this process has counted since it began."""
    with _lock:
        return dict(_totals)


def growth(now: Mapping[str, float], before: Mapping[str, float]) -> Totals:
    """What came since, without what did not change."""
    grown = {key: round(total - before.get(key, 0.0), DIGITS) for key, total in now.items()}
    return {key: total for key, total in grown.items() if total > 0}


DRIVES_DONE = Measure("versant_drives_done_total", "Drives computed and published.", ("method",))
DRIVES_FAILED = Measure(
    "versant_drives_failed_total",
    "Runs of drives that failed, by the kind of the failure.",
    ("method", "kind"),
)
DRIVES_PUT_BACK = Measure(
    "versant_drives_put_back_total",
    "Runs of drives that ended without a result: their worker stopped, or the drive was deleted or asked for anew.",
    ("method", "reason"),
)
QUEUED_S = Measure(
    "versant_drive_queued_seconds", "From the request for a drive to the start of its run.", (), LONG_S
)
STAGE_S = Measure(
    "versant_drive_stage_seconds",
    "Stages of the runs of drives; `publishing` is the wait for the cells to be solved.",
    ("stage", "method"),
    LONG_S,
)
SOLVE_S = Measure(
    "versant_solve_seconds",
    "Solutions of cells of the map from the look at the database to the swap: `marked` for drives, `settled` in "
    "the background.",
    ("kind",),
    LONG_S,
)
CELLS_SOLVED = Measure("versant_cells_solved_total", "Cells in these solutions.", ("kind",))
SQUARES_SOLVED = Measure(
    "versant_squares_solved_total", "Former name of versant_cells_solved_total.", ("kind",)
)
SWAP_CONFLICTS = Measure(
    "versant_swap_conflicts_total",
    "Solutions found out of date when they were to be written, and made again.",
    ("kind",),
)
LOCK_WAIT_S = Measure(
    "versant_lock_wait_seconds",
    "Waits for locks: `own_network` (imports), `share_network` (drives), `own_hours` (drives of one place and hour).",
    ("lock",),
    SHORT_S,
)
IMPORTS = Measure(
    "versant_imports_total", "Imports of roads, elevation and surveyed heights.", ("kind", "outcome")
)
IMPORT_S = Measure("versant_import_seconds", "Imports, from file to commit.", ("kind",), LONG_S)

MEASURES = tuple(one for one in list(globals().values()) if isinstance(one, Measure))
"""All of these, in their order."""
