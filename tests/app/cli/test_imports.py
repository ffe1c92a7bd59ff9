"""What ``versant import-roads`` says beside its bars."""

from __future__ import annotations

from app.cli.imports import remarks, summary
from app.roads.documents import ImportCounts


def test_an_import_without_losses_needs_no_remark() -> None:
    assert remarks(ImportCounts("town", kept=5, moved=1, dropped=2, added=3)) == []


def test_what_becomes_of_segments_is_told() -> None:
    assert summary(ImportCounts("town", kept=5)) == "region town has 5 segments (5 kept, 0 added; 0 dropped)"
    counts = ImportCounts(
        "town", kept=5, moved=4, renumbered=3, reversed=2, far=1, added=6, split=7, merged=8, dropped=9, released=10,
        dry_run=True,
    )  # fmt: skip
    assert summary(counts) == (
        "region town would have 21 segments (5 kept, 4 moved within the tolerance, 3 renumbered, 2 reversed, "
        "1 moved farther, 6 added; 7 split, 8 merged, 9 dropped, 10 left to other regions)"
    )


def test_lost_and_restored_slopes_and_unused_nodes_are_told() -> None:
    counts = ImportCounts(
        "town", kept=5, measured_lost=2, restored=7, drives_again=4,
        skipped={"no length": 1, "node missing from the file": 6},
    )  # fmt: skip
    assert remarks(counts) == [
        "2 segments lose what was measured on them, because they were moved, split, merged or dropped. It is kept for "
        "some time, and comes back if they do.",
        "7 segments have back what was measured before they went.",
        "4 drive(s) are computed again by themselves.",
        "7 node pairs of the file's roads are no segments (no length: 1, node missing from the file: 6).",
    ]
