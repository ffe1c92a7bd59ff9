"""What an import of roads is asked for, and what it says it did, also in sentences. Knows no SQL."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from app.roads.comparing import Loss
from fusion.errors import RoadsError

TOLERANCE_M = 2.0
"""By default (setting ``road_tolerance_m``) a segment whose ends moved by no more keeps what was measured on it."""
MOST_LOST = 0.1
"""An import that would take away what was measured on a larger share of a region's measured segments has to be
confirmed."""
MOST_NAMED = 5
"""Numbers of ways in a sentence."""


@dataclass(frozen=True)
class ImportCounts:
    """What a road import does, in segments. ``kept + moved + renumbered + reversed + far + added`` are in the file.

    Of those that were there ``kept`` are as they were, ``moved`` by no more than the tolerance, ``renumbered`` parts of
    other ways, ``reversed`` in their direction: these keep what was measured. ``far`` ones moved farther, ``split`` and
    ``merged`` ones have other nodes, and ``dropped`` ones are gone; ``released`` ones other regions have.
    ``measured_lost`` of them lose what was measured, ``restored`` of the others have back what was measured before they
    went, and ``drives_again`` drives are computed again. ``skipped`` counts, by reason, the node pairs of the file that
    are no segment (``RoadTable.skipped``). ``longest_hold_s``: so long at most the import kept drives and solvers out.
    """

    region: str
    kept: int = 0
    moved: int = 0
    renumbered: int = 0
    reversed: int = 0
    far: int = 0
    split: int = 0
    merged: int = 0
    dropped: int = 0
    released: int = 0
    added: int = 0
    measured_lost: int = 0
    restored: int = 0
    drives_again: int = 0
    skipped: Mapping[str, int] = field(default_factory=dict)
    dry_run: bool = False
    longest_hold_s: float = field(default=0.0, compare=False)

    @property
    def segments(self) -> int:
        """How many the region has."""
        return self.kept + self.moved + self.renumbered + self.reversed + self.far + self.added


@dataclass(frozen=True)
class Source:
    """A file of roads, and the region that they are to be."""

    name: str
    sha256: str
    region: str
    file_uri: str | None = None
    """Where what it says is kept (``app.roads.region_files``)"""
    file_sha256: str | None = None
    based_on: str | None = None
    """Of changes: the region's kept file that they were applied to"""


@dataclass(frozen=True)
class Wishes:
    """How an import is to be done."""

    dry_run: bool = False
    """Say what it would do, and change nothing"""
    accept_losses: bool = False
    """Though it takes away more than ``MOST_LOST``"""
    tolerance_m: float = TOLERANCE_M
    agree: Callable[[ImportCounts], None] | None = None
    """Is told what would be done, once nobody else can change roads and before anything is; what it raises ends the
    import with nothing changed"""


USUAL = Wishes()


def refuse(losses: Sequence[Loss], region: str, *, removal: bool = False) -> None:
    """``RoadsError`` where any region loses too much, by the removal of ``region`` or as a file takes its place."""
    if large := [one for one in losses if one.lost > MOST_LOST * one.measured]:
        regions = "; ".join(
            f"{one.lost} of the {one.measured} measured segments of {one.region}" for one in large
        )
        elsewhere = (
            "" if removal else "If the file is of another area, name a region of its own by --region. "
        )
        if any(one.ways and one.region != region for one in large):
            elsewhere = "Maps that mean different roads by one number cannot be in one service: renumber one of them. "
        raise RoadsError(
            f"This would take away what was measured on more than a tenth: {regions}. Nothing was changed. "
            f"{''.join(_collisions(one) for one in large)}{elsewhere}"
            "See with --dry-run what it would do; if that is meant, give --yes."
        )


def _collisions(one: Loss) -> str:
    """Which numbers of ways are taken: two files may mean different roads by one."""
    if not one.ways:
        return ""
    rest = len(one.ways) - MOST_NAMED
    shown = ", ".join(str(number) for number in one.ways[:MOST_NAMED]) + (
        f" and {rest} more" if rest > 0 else ""
    )
    return f"By numbers of ways of {one.region} the file has other roads: {shown}. "


_CALLED = {
    "moved": "moved within the tolerance",
    "far": "moved farther",
    "released": "left to other regions",
}
_ALWAYS = ("kept", "added", "dropped")


def summary(counts: ImportCounts) -> str:
    """What an import does to the segments of its region."""
    there = _listed(counts, ("kept", "moved", "renumbered", "reversed", "far", "added"))
    gone = _listed(counts, ("split", "merged", "dropped", "released"))
    would = "would have" if counts.dry_run else "has"
    return f"region {counts.region} {would} {counts.segments} segments ({there}; {gone})"


def _listed(counts: ImportCounts, names: Sequence[str]) -> str:
    """How many of each there are; those of which there are none only where that tells something."""
    numbers = {name: getattr(counts, name) for name in names}
    return ", ".join(f"{n} {_CALLED.get(name, name)}" for name, n in numbers.items() if n or name in _ALWAYS)


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
