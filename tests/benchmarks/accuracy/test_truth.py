"""True slopes and their sigmas: which passes a track makes over a segment, and what their scatter says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accuracy.logs import write_columns
from accuracy.sequences import find_sequences
from accuracy.streets import make_street
from accuracy.truth import Key, Passes, TrueSlope, Truth, passes_of, read_truth, scatter_percent, with_sigmas
from fusion.simulate.scene.town import Town
from fusion.types import Floats

FIRST, SECOND = (1, 1, 2), (1, 2, 3)
PASSES: dict[Key, Passes] = {
    FIRST: Passes(np.array([2.0, 2.3]), np.array([50.0, 50.0])),
    SECOND: Passes(np.array([-1.0]), np.array([80.0])),
}
TRUTH: Truth = {FIRST: TrueSlope(2.15, 50.0, 52.0, 2), SECOND: TrueSlope(-1.0, 80.0, 100.0, 1)}


def test_truth_is_read_with_the_part_that_was_driven_and_the_passes(tmp_path: Path) -> None:
    file = tmp_path / "truth.csv"
    file.write_text(
        "osm_way_id,from_node,to_node,slope_percent,driven_m,length_m,passes\n7,1,2,-3.5,29,45,2\n"
    )
    assert read_truth(file) == {(7, 1, 2): TrueSlope(-3.5, 29.0, 45.0, 2, 0.0)}


def test_the_scatter_of_passes_is_that_of_one_pass() -> None:
    rng = np.random.default_rng(1)
    counts = rng.integers(1, 5, 3000)
    passes = {
        (1, k, k + 1): Passes(rng.normal(3.0, 0.2, n), rng.uniform(10, 90, n)) for k, n in enumerate(counts)
    }
    assert scatter_percent(passes) == pytest.approx(0.2, rel=0.03)
    assert scatter_percent({SECOND: PASSES[SECOND]}) is None


def test_the_sigma_of_a_mean_of_passes_is_true() -> None:
    rng = np.random.default_rng(2)
    length_m = np.array([20.0, 80.0, 50.0])
    means = [Passes(rng.normal(0.0, 0.3, 3), length_m).mean_percent for _ in range(5000)]
    assert Passes(np.zeros(3), length_m).mean_sigma_percent(0.3) == pytest.approx(np.std(means), rel=0.05)


def test_a_log_made_of_the_track_says_the_same_where_it_passed_once() -> None:
    one = 0.3 / np.sqrt(2)
    made = with_sigmas(TRUTH, PASSES, made_log=True)
    assert made[FIRST].sigma_percent == pytest.approx(one / np.sqrt(2))
    assert made[SECOND].sigma_percent == 0.0
    recorded = with_sigmas(TRUTH, PASSES, made_log=False)
    assert recorded[SECOND].sigma_percent == pytest.approx(one)
    assert recorded[FIRST]._replace(sigma_percent=0.0) == TRUTH[FIRST]


def test_passes_that_the_truth_was_not_made_of_say_nothing() -> None:
    other = {**PASSES, FIRST: Passes(np.array([5.0, 5.3]), np.array([50.0, 50.0]))}
    assert with_sigmas(TRUTH, other, made_log=True) == TRUTH
    fewer = {**PASSES, FIRST: Passes(np.array([2.15]), np.array([50.0]))}
    assert with_sigmas(TRUTH, fewer, made_log=True) == TRUTH


def test_parts_of_one_pass_are_not_compared() -> None:
    parts = {**PASSES, FIRST: Passes(np.array([0.15, 3.15]), np.array([10.0, 20.0]))}
    assert with_sigmas(TRUTH, parts, made_log=False) == TRUTH


def track_along(street: Town, east_m: Floats, height_m: Floats, path: Path) -> Path:
    """A precise track 1 m beside the street, without its first place."""
    lon, lat = street.projection.to_lonlat(east_m, np.full(len(east_m), 1.0))
    valid = np.ones(len(east_m))
    valid[0] = 0.0
    time_s = 0.1 * np.arange(len(east_m))
    columns = {"t_s": time_s, "lat_deg": lat, "lon_deg": lon, "alt_m": height_m, "valid": valid}
    return write_columns(columns, path)


def test_a_track_there_and_back_makes_two_passes(tmp_path: Path) -> None:
    street = make_street(np.array([0.0, 60.0, 100.0]), np.zeros(3), np.zeros(3))
    there = np.arange(-20.0, 75.0)
    east = np.concatenate([there, there[::-1]])
    # Back the road seems steeper by half a percent of slope.
    height = 100 + np.concatenate([0.02 * there, 0.02 * there[-1] + 0.025 * (there[::-1] - there[-1])])
    passes = passes_of(track_along(street, east, height, tmp_path / "ref.csv"), street.roads)
    first, second = (
        (int(w), int(a), int(b))
        for w, a, b in zip(street.roads.osm_way_id, street.roads.from_node, street.roads.to_node, strict=True)
    )
    np.testing.assert_allclose(passes[first].slope_percent, [2.0, 2.5], atol=0.01)
    assert np.all(np.abs(passes[first].length_m - 60) < 8)
    assert len(passes[second].slope_percent) == 1  # the track turns on it without leaving


def test_the_passes_of_surveyed_roads_are_those_of_their_truth(karlsruhe: Path) -> None:
    for sequence in find_sequences(karlsruhe):
        assert sequence.reference is not None
        passes = passes_of(sequence.reference, sequence.roads)
        assert passes.keys() == sequence.truth.keys()
        for key, true in sequence.truth.items():
            assert len(passes[key].slope_percent) == true.passes
            assert passes[key].mean_percent == pytest.approx(true.slope_percent, abs=0.01)
            assert (true.sigma_percent > 0) == (true.passes > 1)
