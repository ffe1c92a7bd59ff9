"""What became of road segments between two states of a map: which are the same, which moved, which are gone.

A segment's identity is (way, from_node, to_node). Mappers give ways new numbers, turn them round, split and join them,
and put nodes where they belong; the road is the same as long as it runs between the same nodes in the same place.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from fusion.frames import METRES_PER_DEGREE
from fusion.roads.table import RoadTable, identities
from fusion.types import Bools, Floats, Ints


class Change(IntEnum):
    """What became of a segment that was there."""

    KEPT = 0
    MOVED = 1
    """Its ends by no more than the tolerance"""
    RENUMBERED = 2
    """The same two nodes, as part of another way"""
    REVERSED = 3
    """The same two nodes in the other direction, perhaps as part of another way"""
    FAR = 4
    """The same way and nodes, but an end lies farther away than the tolerance"""
    SPLIT = 5
    """Its way has nodes between its two now"""
    MERGED = 6
    """Its way has lost one of its nodes, and runs on without it"""
    DROPPED = 7
    RELEASED = 8
    """Not in the file any more, but other files have it"""


_LONGEST_CHAIN = 1000
_Key = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class RoadChanges:
    """Rows of the stored roads and of the file that are one road, and what is left of both.

    ``stored`` (m,) are the rows of stored segments that the file speaks of, ``change`` (m,) what became of each,
    ``row`` (m,) the row of the file that takes its place, -1 for none. ``added`` (k,) are the rows of the file that
    take no place. Each row of the file is in ``row`` or in ``added``, once.
    """

    stored: Ints
    change: Ints
    row: Ints
    added: Ints

    def of(self, *changes: Change) -> Ints:
        """Positions in ``stored`` of what became of them this."""
        return np.flatnonzero(np.isin(self.change, changes))


def compare(
    stored: RoadTable, member: Bools, others: Bools, file: RoadTable, tolerance_m: float
) -> RoadChanges:
    """What became of the n ``stored`` segments by a new ``file`` of a region.

    ``member`` (n,): the segment was in an older file of this region. ``others`` (n,): it is in files of other
    regions. On a way that the file has, the file counts between those of the way's nodes that it has. Beyond them a
    segment stays if another region has it.
    """
    rows = {key: row for row, key in enumerate(identities(file))}
    at = np.array([rows.get(key, -1) for key in identities(stored)], np.int64)
    change = np.full(len(stored), -1, np.int64)
    same = np.flatnonzero(at >= 0)
    was, now = ends_of(stored, same), ends_of(file, at[same])
    off, equal = ends_apart_m(was, now), np.all(was == now, axis=1)
    change[same] = np.where(equal, Change.KEPT, np.where(off <= tolerance_m, Change.MOVED, Change.FAR))
    free = np.setdiff1d(np.arange(len(file)), at[same])
    for old, new, kind in _same_nodes(stored, np.flatnonzero(at < 0), file, free, tolerance_m):
        at[old], change[old] = new, kind
    gone, free = np.flatnonzero(at < 0), np.setdiff1d(np.arange(len(file)), at)
    replaced = _replaced(stored, gone, file)
    lost = replaced | (member[gone] & ~others[gone])
    change[gone[lost]] = Change.DROPPED
    change[gone[~lost & member[gone]]] = Change.RELEASED
    _note_split_and_merged(stored, gone[lost], file, free, change)
    spoken = np.flatnonzero(change >= 0)
    return RoadChanges(spoken, change[spoken], at[spoken], free)


def ends_of(table: RoadTable, rows: Ints) -> Floats:
    """The ends of these segments, degrees, (m, 4): lon0, lat0, lon1, lat1."""
    return np.column_stack(
        [column[rows] for column in (table.lon0_deg, table.lat0_deg, table.lon1_deg, table.lat1_deg)]
    )


def ends_apart_m(ends: Floats, other: Floats) -> Floats:
    """How far the farther of the two ends of each segment lies from that of another, m; (m, 4) both -> (m,)."""
    east = (ends[:, ::2] - other[:, ::2] + 180) % 360 - 180
    east *= np.cos(np.radians(ends[:, 1::2]))
    apart = METRES_PER_DEGREE * np.hypot(east, ends[:, 1::2] - other[:, 1::2])
    return np.asarray(apart.max(axis=1, initial=0.0))


def _same_nodes(
    stored: RoadTable, gone: Ints, file: RoadTable, free: Ints, tolerance_m: float
) -> Iterator[tuple[int, int, Change]]:
    """Pairs of what is missing and what is new between the same two nodes in the same place."""
    waiting: dict[tuple[int, int], list[int]] = {}
    for old in gone.tolist():
        pair = int(stored.from_node[old]), int(stored.to_node[old])
        waiting.setdefault((min(pair), max(pair)), []).append(old)
    for new in free.tolist():
        a, b, way = int(file.from_node[new]), int(file.to_node[new]), int(file.osm_way_id[new])
        candidates = waiting.get((min(a, b), max(a, b)), [])
        # Of its own way first, then in its own direction.
        for old in sorted(
            candidates, key=lambda k: (stored.osm_way_id[k] != way, stored.from_node[k] != a, k)
        ):
            back = bool(stored.from_node[old] != a)
            ends = ends_of(file, np.array([new]))[:, [2, 3, 0, 1] if back else [0, 1, 2, 3]]
            if ends_apart_m(ends_of(stored, np.array([old])), ends)[0] <= tolerance_m:
                candidates.remove(old)
                yield old, new, Change.REVERSED if back else Change.RENUMBERED
                break


def _replaced(stored: RoadTable, gone: Ints, file: RoadTable) -> Bools:
    """Which of these segments the file replaces by another course: those between two nodes of their way that it has."""
    ways = np.unique(stored.osm_way_id[gone])
    mine = np.flatnonzero(np.isin(file.osm_way_id, ways))
    nodes: dict[int, set[int]] = {}
    for k in mine.tolist():
        nodes.setdefault(int(file.osm_way_id[k]), set()).update(
            (int(file.from_node[k]), int(file.to_node[k]))
        )
    keys = list(identities(stored.subset(gone)))
    after = {(way, a): b for way, a, b in keys}
    before = {(way, b): a for way, a, b in keys}

    def reaches(way: int, node: int, step: dict[tuple[int, int], int]) -> bool:
        known = nodes.get(way, set())
        for _ in range(_LONGEST_CHAIN):
            if node in known:
                return True
            if (way, node) not in step:
                return False
            node = step[way, node]
        return False

    return np.array([reaches(way, a, before) and reaches(way, b, after) for way, a, b in keys], np.bool_)


def _note_split_and_merged(stored: RoadTable, lost: Ints, file: RoadTable, free: Ints, change: Ints) -> None:
    """Mark segments that are gone only because their way has more or fewer nodes there than before."""
    old, new = (list(identities(part)) for part in (stored.subset(lost), file.subset(free)))
    row = {key: int(k) for key, k in zip(old, lost, strict=True)}
    new_after, old_after = ({(way, a): b for way, a, b in keys} for keys in (new, old))
    for key in old:
        if _chain(*key, new_after):
            change[row[key]] = Change.SPLIT
    for key in new:
        for part in _chain(*key, old_after):
            change[row[part]] = Change.MERGED


def _chain(way: int, a: int, b: int, after: dict[tuple[int, int], int]) -> list[_Key]:
    """The segments by which a way goes from one node to another; none where it does not."""
    keys: list[_Key] = []
    node = a
    while (way, node) in after and len(keys) < _LONGEST_CHAIN:
        following = after[way, node]
        keys.append((way, node, following))
        if following == b:
            return keys
        node = following
    return []
