"""Lines of roads: arcs have their radii, ends stay, nodes follow the bends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from published.particle.scene.alignment import (
    arc,
    at,
    beside,
    distances,
    eased,
    nearest,
    node_places,
    rounded,
)


def curvature(line: np.ndarray) -> np.ndarray:
    """Absolute curvature along a line, 1/m, by differences over ten points."""
    s, step = distances(line), 10
    heading = np.unwrap(np.arctan2(*(line[step:] - line[:-step])[:, ::-1].T))
    middle = (s[step:] + s[:-step]) / 2
    return np.abs(np.gradient(heading, middle))


@given(radius=st.floats(60, 150), turn=st.floats(0.6, 2.0), left=st.booleans())
def test_rounded_corners_have_their_radius(radius: float, turn: float, left: bool) -> None:
    direction = turn if left else -turn
    end = (500 + 500 * np.cos(direction), 500 * np.sin(direction))
    line = rounded([(0.0, 0.0), (500.0, 0.0), end], [radius])
    np.testing.assert_allclose(line[0], (0, 0), atol=1e-9)
    np.testing.assert_allclose(line[-1], end, atol=1e-9)
    if radius * turn > 60:  # long enough an arc to reach its curvature between the transitions
        assert curvature(line).max() == pytest.approx(1 / radius, rel=0.12)
    assert distances(line)[-1] < 1000


def test_arcs_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="an arc of 300 m does not fit"):
        rounded([(0.0, 0.0), (100.0, 0.0), (100.0, 100.0)], [300.0])


def test_arc_starts_and_turns_as_told() -> None:
    points = arc(np.array([10.0, 20.0]), 50.0, np.pi / 2, -np.pi)
    np.testing.assert_allclose(points[0], (10, 70))
    np.testing.assert_allclose(points[-1], (10, -30), atol=1e-9)
    np.testing.assert_allclose(np.hypot(*(points - (10, 20)).T), 50.0)
    assert points[len(points) // 2, 0] > 50  # clockwise from the top: by way of the east


def test_easing_keeps_ends_and_their_directions() -> None:
    sharp = np.array([[0.0, 0.0], [200.0, 0.0], [200.0, 200.0]])
    line = eased(sharp, 15.0)
    np.testing.assert_allclose(line[[0, -1]], sharp[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(line[5] - line[0], (5, 0), atol=0.01)
    # a blur of width w turns a right angle within a curvature of 4 phi(0) / w / sqrt 2, 1.13 / w
    assert curvature(line).max() == pytest.approx(1.13 / 15, rel=0.1)


@given(radius=st.floats(30, 3000), longest=st.floats(40, 250), forced=st.floats(0.2, 0.8))
def test_nodes_follow_the_bend(radius: float, longest: float, forced: float) -> None:
    line = arc(np.zeros(2), radius, 0.0, 600.0 / radius)
    length = distances(line)[-1]
    places = node_places(line, longest, [forced * length])
    assert places[0] == 0
    assert places[-1] == pytest.approx(length)
    assert np.abs(places - forced * length).min() < 1e-6
    chord = np.diff(places)
    assert chord.min() > 0
    assert chord.max() < 1.5 * longest
    sagitta = radius * (1 - np.cos(chord / 2 / radius))
    assert sagitta.max() < 1.4  # half a metre, but what is forced lets chords be half as long again
    points = at(line, places)
    np.testing.assert_allclose(np.hypot(*points.T), radius, rtol=1e-3)


def test_beside_lies_to_the_right() -> None:
    line = np.column_stack([np.linspace(0, 100, 101), np.zeros(101)])
    np.testing.assert_allclose(beside(line, 9.0)[:, 1], -9.0)
    np.testing.assert_allclose(beside(line[::-1], 9.0)[:, 1], 9.0)
    assert nearest(line, (40.2, 30.0)) == pytest.approx(40.0)
