"""What an import of roads does, in sentences for people."""

from __future__ import annotations

from app.roads.documents import ImportCounts


def summary(counts: ImportCounts) -> str:
    """What an import does to the segments of its region."""
    parts = {
        "kept": counts.kept,
        "moved within the tolerance": counts.moved,
        "renumbered": counts.renumbered,
        "reversed": counts.reversed,
        "moved farther": counts.far,
        "added": counts.added,
    }
    gone = {
        "split": counts.split,
        "merged": counts.merged,
        "dropped": counts.dropped,
        "left to other regions": counts.released,
    }
    lists = [", ".join(f"{n} {name}" for name, n in some.items() if n or name in ("kept", "added", "dropped"))
            for some in (parts, gone)]  # fmt: skip
    would = "would have" if counts.dry_run else "has"
    return f"region {counts.region} {would} {counts.segments} segments ({lists[0]}; {lists[1]})"


def remarks(counts: ImportCounts) -> list[str]:
    """What a road import cost, brought back and could not use, a sentence each."""
    will = "would " if counts.dry_run else ""
    lines = []
    if counts.measured_lost:
        lines.append(
            f"{counts.measured_lost} segments {will}lose what was measured on them, because they were moved, split, "
            "merged or dropped. It is kept for some time, and comes back if they do."
        )
    if counts.restored:
        lines.append(f"{counts.restored} segments {will}have back what was measured before they went.")
    if counts.drives_again:
        lines.append(
            f"{counts.drives_again} drive(s) {will or 'are '}{'be ' if will else ''}computed again by themselves."
        )
    if counts.skipped:
        reasons = ", ".join(f"{reason}: {count}" for reason, count in sorted(counts.skipped.items()))
        lines.append(
            f"{sum(counts.skipped.values())} node pairs of the file's roads are no segments ({reasons})."
        )
    return lines
