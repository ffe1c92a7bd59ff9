"""Places onto a line: where the line meets itself the order of the places decides, in either direction."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.errors import EmptyLogError, NoMatchError
from fusion.frames import LocalProjection
from fusion.scoring.made import SEEDS, made_reference
from fusion.scoring.placing import BACK_M, placed
from fusion.scoring.profiles import Profile, Reference, along_of
from fusion.types import Floats

PLANE = LocalProjection(8.0, 49.0)


def reference_along(xy_m: Floats) -> Reference:
    """A line through these corners, a point every 5 m, of no slope."""
    corners_m = np.r_[0.0, np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T))]
    along = np.arange(0.0, corners_m[-1] + 1e-9, 5.0)
    places = [np.interp(along, corners_m, xy_m[:, axis]) for axis in (0, 1)]
    return Reference.of("line", Profile(np.zeros(len(along)), along, degrees(*places)))


def degrees(x_m: Floats, y_m: Floats) -> Floats:
    return np.column_stack(PLANE.to_lonlat(x_m, y_m))


def scattered(reference: Reference, rows: Floats, sigma_m: float = 3.0) -> Profile:
    """The reference's points of these rows, as a receiver logs them."""
    rng = np.random.default_rng(5)
    assert reference.places_deg is not None
    xy = np.column_stack(PLANE.to_xy(*reference.places_deg.T))[rows]
    return Profile(np.zeros(len(rows)), places_deg=degrees(*(xy + sigma_m * rng.normal(size=xy.shape)).T))


OUT_AND_BACK = np.array([[0.0, 0], [600, 0], [600, 12], [0, 12]])
EIGHT = np.array([[0.0, 0], [400, 400], [800, 0], [800, 400], [400, 0], [0, 400]])


@pytest.mark.parametrize("line", [OUT_AND_BACK, EIGHT], ids=["out and back", "eight"])
@pytest.mark.parametrize("way", [1, -1], ids=["along", "against"])
def test_order_tells_which_passage_a_place_belongs_to(line: Floats, way: int) -> None:
    reference = reference_along(line)
    rows = np.arange(0, len(reference.along_m), 3)[::way]
    found = placed(reference, scattered(reference, rows), "x")
    assert found.backwards == (way == -1)
    assert found.share > 0.98
    error = found.along_m - reference.along_m[rows]
    known = np.isfinite(error)
    assert np.median(np.abs(error[known])) < 4.0
    # Round a turn that is narrower than places scatter they may lie on either side of it.
    assert np.mean(np.abs(error[known]) < 25.0) > 0.97
    assert found.beside_m == pytest.approx(2.0, abs=0.7)


@pytest.mark.parametrize("name", SEEDS)
def test_places_never_go_back_on_made_references(name: str) -> None:
    reference = Reference.of(name, made_reference(name))
    assert reference.places_deg is not None
    rng = np.random.default_rng(1)
    rows = np.arange(0, len(reference.along_m), 4)
    places = reference.places_deg[rows] + rng.normal(0, 3e-5, (len(rows), 2))
    found = placed(reference, Profile(np.zeros(len(rows)), places_deg=places), "x")
    known = found.along_m[np.isfinite(found.along_m)]
    assert (np.diff(known) >= 0).all()
    error = np.abs(found.along_m - reference.along_m[rows])
    assert np.nanmax(error) < 20
    assert np.nanmedian(error) < 3
    assert found.share > 0.98


def test_what_leaves_the_line_is_left_out_and_said() -> None:
    reference = reference_along(np.array([[0.0, 0], [1000, 0]]))
    x = np.arange(0.0, 1000, 10.0)
    y = np.where((x > 300) & (x < 700), 200.0, 1.0)
    found = placed(reference, Profile(np.zeros(len(x)), places_deg=degrees(x, y)), "x")
    assert found.share == pytest.approx(0.61, abs=0.01)
    assert np.isnan(found.along_m[y > 100]).all()
    assert found.along_m[y < 100] == pytest.approx(x[y < 100], abs=0.5)
    assert (np.diff(found.along_m[np.isfinite(found.along_m)]) > -BACK_M).all()


def test_what_lies_elsewhere_is_refused() -> None:
    reference = reference_along(np.array([[0.0, 0], [1000, 0]]))
    x = np.arange(0.0, 1000, 10.0)
    with pytest.raises(NoMatchError, match="x does not lie on line"):
        placed(reference, Profile(np.zeros(len(x)), places_deg=degrees(x, x + 500.0)), "x")


def test_without_places_distances_count_and_a_profile_of_nothing_is_no_reference() -> None:
    reference = reference_along(np.array([[0.0, 0], [1000, 0]]))
    found = placed(reference, Profile(np.zeros(3), along_m=np.array([0.0, 500, 1500])), "x")
    assert found.along_m == pytest.approx([0, 500, np.nan], nan_ok=True)
    assert found.share == pytest.approx(2 / 3)
    own = along_of(Profile(np.zeros(3), places_deg=degrees(np.array([0.0, 30, 30]), np.array([0.0, 0, 40]))))
    assert own == pytest.approx([0, 30, 70], abs=0.01)
    with pytest.raises(EmptyLogError, match="fewer than two points"):
        Reference.of("nothing", Profile(np.array([np.nan, 3.0]), along_m=np.array([0.0, 1.0])))
