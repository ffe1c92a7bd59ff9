"""What ``versant import-roads`` says beside its counts."""

from __future__ import annotations

from app.cli.imports import remarks
from app.roads.imports import ImportCounts


def test_an_import_without_losses_needs_no_remark() -> None:
    assert remarks(ImportCounts(kept=5, moved=1, dropped=2, added=3)) == []


def test_lost_slopes_and_unused_nodes_are_told() -> None:
    counts = ImportCounts(
        kept=5, moved=1, dropped=2, added=3, measured_lost=2, drives_affected=4,
        skipped={"no length": 1, "node missing from the file": 6},
    )  # fmt: skip
    lost, unused = remarks(counts)
    assert lost == (
        "2 segments lost measured slopes, because they or the roads that lead to them were moved or dropped, "
        "from 4 drive(s); reprocess those drives to measure again."
    )
    assert unused == (
        "7 node pairs of the file's roads are no segments (no length: 1, node missing from the file: 6)."
    )
