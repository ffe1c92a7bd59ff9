"""Where along its way a segment lies: the order of its nodes, and only of ways that are whole here."""

from __future__ import annotations

from array import array

import numpy as np
import pytest

from app.exports.writing.way_places import WayEnds, courses_of
from app.map.segment import Segment


def segment(number: int, a: int, b: int, way: int = 7) -> Segment:
    places = {node: (8.0 + node / 1e4, 49.0 + (node % 3) / 1e4) for node in (a, b)}
    return Segment(
        id=number, osm_way_id=way, from_node=a, to_node=b, length_m=10.0, highway="track", name=None, oneway=0,
        bridge=False, tunnel=False, slope_percent=None, slope_sigma_percent=None, drives=0, observations=0,
        dem_slope_percent=None, updated_at=None, coordinates=(places[a], places[b]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("pairs", "ends", "wanted"),
    [
        ([(1, 2), (2, 3), (3, 4)], (1, 4), [1, 2, 3, 4]),
        ([(2, 3), (3, 4)], (1, 4), None),  # an extract cut it
        ([(1, 2), (3, 4)], (1, 4), None),  # a gap
        ([(3, 1), (1, 2), (2, 3)], (1, 1), [1, 2, 3, 1]),  # a ring begins where the file says
        ([(1, 2)], None, None),  # no file has it
    ],
)
def test_only_whole_ways_have_a_course(
    pairs: list[tuple[int, int]], ends: tuple[int, int] | None, wanted: list[int] | None
) -> None:
    segments = [segment(number, a, b) for number, (a, b) in enumerate(pairs, 1)]
    rows = [] if ends is None else [7, *ends, 1]
    known = WayEnds(array("q", rows[:1]), tuple(array("q", [one]) for one in rows[1:]))
    course = courses_of(segments, known).get(7)
    if wanted is None:
        assert course is None
        return
    assert course is not None
    assert [course.node(k) for k in range(len(wanted))] == wanted
    assert course.share.tolist() == pytest.approx(np.linspace(0, 1, len(wanted)).tolist())
