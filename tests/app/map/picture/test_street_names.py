"""Where names of streets stand: along the longest measured ones, in the frame, on no other name."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from app.map.picture.lettering import MOST_NAMES, StreetName, place_names
from fusion.types import Floats

FRAME = (-1000.0, -1000.0, 1000.0, 1000.0)
HEIGHT_M, LETTER_M = 20.0, 12.0


def placed(
    lines: Floats, names: list[str | None], measured: NDArray[np.bool_] | None = None
) -> list[StreetName]:
    lines = np.asarray(lines, float).reshape(-1, 2, 2)
    known = np.ones(len(lines), np.bool_) if measured is None else measured
    return place_names(
        lines,
        np.array(names, np.object_),
        known,
        frame_m=FRAME,
        height_m=HEIGHT_M,
        length_m=lambda text: LETTER_M * len(text),
    )


def road(x0: float, y0: float, x1: float, y1: float, pieces: int = 8) -> list[list[list[float]]]:
    """A straight street in pieces."""
    x, y = np.linspace(x0, x1, pieces + 1), np.linspace(y0, y1, pieces + 1)
    points = np.column_stack([x, y])
    return np.stack([points[:-1], points[1:]], axis=1).tolist()  # type: ignore[no-any-return]


@pytest.mark.parametrize("angle", [0.0, 0.7, 1.5, -1.2, 3.0, 2.0])
def test_a_name_stands_beside_its_street_and_can_be_read_from_below(angle: float) -> None:
    end = 500 * np.array([np.cos(angle), np.sin(angle)])
    (name,) = placed(road(*-end, *end), ["Hauptstraße"] * 8)
    along, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    middle = np.array([name.x_m, name.y_m])
    assert abs(middle @ across) == pytest.approx(HEIGHT_M)
    assert abs(middle @ along) < 100, "near the middle of the street"
    assert -np.pi / 2 <= name.angle_rad <= np.pi / 2
    assert abs(np.sin(name.angle_rad - angle)) < 1e-6


def test_only_measured_streets_with_a_name_and_room_are_named() -> None:
    lines = [
        *road(-900, 0, 900, 0),
        *road(-900, 300, 900, 300),
        *road(-900, 600, 900, 600),
        *road(0, -500, 40, -500),
    ]
    names = ["Lang"] * 8 + [None] * 8 + ["Ungemessen"] * 8 + ["Zu kurz"] * 8
    measured = np.array([name != "Ungemessen" for name in names])
    assert [name.text for name in placed(lines, names, measured)] == ["Lang"]


def test_the_longest_streets_come_first_and_only_so_many() -> None:
    count = MOST_NAMES + 3
    heights = np.linspace(-900, 900, count)
    lines = [piece for k, y in enumerate(heights) for piece in road(-200 - 9 * k, y, 200 + 9 * k, y)]
    names = [f"Weg {k:02d}" for k in range(count) for _ in range(8)]
    found = [name.text for name in placed(lines, names)]
    assert found == [f"Weg {k:02d}" for k in range(count - 1, 2, -1)]


def test_a_name_stands_on_no_road_where_there_is_room_elsewhere() -> None:
    main = road(-900, 0, 900, 0, 30)
    crowd = [piece for x in np.linspace(-300, 300, 40) for piece in road(x, -200, x, 200)]
    (name,) = placed([*main, *crowd], ["Hauptstraße"] * 30 + [None] * len(crowd))
    assert abs(name.x_m) > 300 + LETTER_M * len("Hauptstraße") / 2


def test_no_name_stands_on_a_bend() -> None:
    circle = np.linspace(0, 2 * np.pi, 40)
    ring = 60 * np.column_stack([np.cos(circle), np.sin(circle)])
    assert placed(np.stack([ring[:-1], ring[1:]], axis=1), ["Am Rondell 1"] * 39) == []


spots = st.integers(-12, 12).map(lambda k: 80.0 * k)


@settings(max_examples=10)
@given(st.lists(st.tuples(spots, spots, spots, spots), min_size=1, max_size=6))
@example([(-960.0, 0.0, 960.0, 0.0)] * 4)
def test_names_lie_in_the_frame_and_apart(ends: list[tuple[float, float, float, float]]) -> None:
    lines = [piece for end in ends for piece in road(*end)]
    found = placed(lines, [f"Street {k}" for k in range(len(ends)) for _ in range(8)])
    corners = []
    for name in found:
        along = np.array([np.cos(name.angle_rad), np.sin(name.angle_rad)])
        across = np.array([-along[1], along[0]])
        half = LETTER_M * len(name.text) / 2
        u, v = np.meshgrid(np.linspace(-half, half, 50), np.linspace(-HEIGHT_M / 2, HEIGHT_M / 2, 9))
        points = np.array([name.x_m, name.y_m]) + u.reshape(-1, 1) * along + v.reshape(-1, 1) * across
        assert np.all(np.abs(points) < 1000)
        corners.append((points, name, along, across, half))
    for one in corners:
        for other in corners:
            if one is not other:
                away = one[0] - np.array([other[1].x_m, other[1].y_m])
                inside = (np.abs(away @ other[2]) < 0.98 * other[4]) & (
                    np.abs(away @ other[3]) < 0.45 * HEIGHT_M
                )
                assert not inside.any()
