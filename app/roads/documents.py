"""What an import of roads is asked for, and what it says it did, also in sentences. Knows no SQL."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from app.core.messages import say
from app.roads.comparing import Loss
from fusion.errors import RoadsError
from fusion.messages import joined

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
        regions = [say("roads.loss", n=one.lost, measured=one.measured, region=one.region) for one in large]
        elsewhere = "" if removal else say("roads.name_a_region")
        if any(one.ways and one.region != region for one in large):
            elsewhere = say("roads.renumber")
        lost = say("roads.too_much_lost", regions=joined(regions, "; "))
        raise RoadsError(joined([lost, *map(_collisions, large), elsewhere, say("roads.if_meant")]))


def _collisions(one: Loss) -> str:
    """Which numbers of ways are taken: two files may mean different roads by one."""
    if not one.ways:
        return ""
    rest = len(one.ways) - MOST_NAMED
    shown = ", ".join(str(number) for number in one.ways[:MOST_NAMED])
    return say(
        "roads.collisions", region=one.region, shown=shown, more=say("more", n=rest) if rest > 0 else ""
    )


_ALWAYS = ("kept", "added", "dropped")


def summary(counts: ImportCounts) -> str:
    """What an import does to the segments of its region."""
    there = _listed(counts, ("kept", "moved", "renumbered", "reversed", "far", "added"))
    gone = _listed(counts, ("split", "merged", "dropped", "released"))
    key = "roads.would_have" if counts.dry_run else "roads.has"
    return say(key, region=counts.region, n=counts.segments, there=there, gone=gone)


def _listed(counts: ImportCounts, names: Sequence[str]) -> str:
    """How many of each there are; those of which there are none only where that tells something."""
    numbers = {name: getattr(counts, name) for name in names}
    listed = [say(f"roads.{name}", n=n) for name, n in numbers.items() if n or name in _ALWAYS]
    return joined(listed, ", ")


def remarks(counts: ImportCounts) -> list[str]:
    """What a road import cost, brought back and could not use, a sentence each."""
    would = "would" if counts.dry_run else "will"
    lines: list[str] = []
    if counts.measured_lost:
        lines.append(say(f"roads.{would}_lose", n=counts.measured_lost))
    if counts.restored:
        lines.append(say(f"roads.{would}_have_back", n=counts.restored))
    if counts.drives_again:
        lines.append(say(f"roads.{would}_be_computed", n=counts.drives_again))
    if counts.skipped:
        reasons = [say("reason_count", reason=reason, n=n) for reason, n in sorted(counts.skipped.items())]
        lines.append(say("roads.skipped", n=sum(counts.skipped.values()), reasons=joined(reasons, ", ")))
    return lines
