"""Lines through altitudes: slopes, signs, passes, and sigmas checked by simulation."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.published.epochs.line import AltitudeErrors, line_weights, passes, segment_slopes
from fusion.types import Track


def make_track(
    segment: list[int], distance: list[float], altitude: list[float], time: list[float] | None = None
) -> Track:
    n = len(segment)
    nothing = np.full(n, np.nan)
    return Track(
        time_s=np.arange(n, dtype=float) if time is None else np.array(time, float),
        lat_deg=nothing,
        lon_deg=nothing,
        alt_m=np.array(altitude, float),
        h_sigma_m=nothing,
        alt_sigma_m=nothing,
        speed_mps=np.full(n, 10.0),
        heading_rad=nothing,
        pitch_rad=nothing,
        pitch_sigma_rad=nothing,
        segment=np.array(segment, np.int64),
        distance_m=np.array(distance, float),
        has_gnss=np.ones(n, bool),
        after_outage=np.zeros(n, bool),
    )


def white(sigma_m: float) -> Callable[..., np.ndarray]:
    return lambda epochs: np.eye(len(epochs)) * sigma_m**2


@given(
    slope=st.floats(-0.3, 0.3),
    offset=st.floats(-100, 3000),
    distance=st.lists(st.floats(0, 500), min_size=4, max_size=30).filter(lambda d: np.ptp(d) > 6),
)
def test_a_straight_road_gives_its_slope_exactly(slope: float, offset: float, distance: list[float]) -> None:
    track = make_track([7] * len(distance), distance, [offset + slope * d for d in distance])
    (found,) = segment_slopes(track, white(0.1))
    assert found.segment == 7
    assert found.slope_percent == pytest.approx(100 * slope, abs=1e-6)
    assert found.observations == len(distance)


def test_the_sign_is_the_ways_whichever_way_the_vehicle_went() -> None:
    up = make_track([1] * 5, [0, 10, 20, 30, 40], [100, 101, 102, 103, 104])
    back = make_track([1] * 5, [40, 30, 20, 10, 0], [104, 103, 102, 101, 100])
    for track in (up, back):
        (found,) = segment_slopes(track, white(0.1))
        assert found.slope_percent == pytest.approx(10.0)


def test_too_few_epochs_too_short_a_way_and_unknown_heights_give_nothing() -> None:
    assert segment_slopes(make_track([1] * 3, [0, 10, 20], [0, 1, 2]), white(1)) == ()
    assert segment_slopes(make_track([1] * 6, [3, 3.1, 3, 3.2, 3, 3], [0] * 6), white(1)) == ()
    assert segment_slopes(make_track([1] * 4, [0, 10, 20, 30], [0, np.nan, 2, 3]), white(1)) == ()
    assert segment_slopes(make_track([-1] * 4, [np.nan] * 4, [0, 1, 2, 3]), white(1)) == ()


def test_two_passes_are_kept_apart_and_combined() -> None:
    segment = [1] * 4 + [2] * 2 + [1] * 4
    distance = [0, 10, 20, 30, 0, 5, 30, 20, 10, 0]
    altitude = [0, 1, 2, 3, 0, 0, 53, 52, 51, 50]  # another height offset on the way back
    (found,) = segment_slopes(make_track(segment, distance, altitude), white(0.5))
    assert found.passes == 2
    assert found.observations == 8
    assert found.slope_percent == pytest.approx(10.0)
    assert (found.first_time_s, found.last_time_s) == (0.0, 9.0)


def test_a_long_break_parts_a_stay_in_two() -> None:
    track = make_track([3] * 5, [0.0] * 5, [0.0] * 5, [0.0, 1.0, 2.0, 100.0, 101.0])
    assert [len(e) for _, e in passes(track, 5.0)] == [3, 2]
    assert list(passes(make_track([], [], []), 5.0)) == []


def test_a_sparse_log_is_not_cut_at_every_epoch() -> None:
    track = make_track([3] * 5, [0.0] * 5, [0.0] * 5, [0.0, 10.0, 20.0, 90.0, 100.0])
    assert [len(e) for _, e in passes(track, 5.0)] == [3, 2]


def test_no_line_is_drawn_across_a_new_start() -> None:
    """The estimate jumps by 20 m where the filter began anew: each side is a pass of its own."""
    track = make_track([1] * 8, [0, 10, 20, 30, 40, 50, 60, 70], [0, 1, 2, 3, 24, 25, 26, 27])
    track.after_outage[4] = True
    (found,) = segment_slopes(track, white(0.5))
    assert found.passes == 2
    assert found.slope_percent == pytest.approx(10.0)


def test_standing_epochs_and_impossible_slopes_are_left_out() -> None:
    standing = make_track([1] * 8, [0, 10, 20, 30, 30, 30, 30, 30], [0, 1, 2, 3, 9, 9, 9, 9])
    standing.speed_mps[4:] = 0.2
    (found,) = segment_slopes(standing, white(0.5))
    assert found.observations == 4
    assert found.slope_percent == pytest.approx(10.0)
    assert segment_slopes(make_track([1] * 4, [0, 2, 4, 6], [0, 9, 18, 27]), white(0.5)) == ()


def test_line_weights_are_those_of_an_independent_least_squares() -> None:
    rng = np.random.default_rng(1)
    distance, altitude = rng.uniform(0, 100, 12), rng.normal(0, 3, 12)
    assert line_weights(distance) @ altitude == pytest.approx(np.polyfit(distance, altitude, 1)[0])


def test_sigma_is_the_spread_of_simulated_slopes() -> None:
    """Draw altitude errors of each kind by brute force; the model's sigma is their slopes' standard deviation."""
    rng = np.random.default_rng(2)
    n, runs = 8, 40_000
    time_s = np.arange(n) * 1.0
    speed = np.full(n, 10.0)
    model = AltitudeErrors(time_s, speed, np.full(n, 0.3), np.full(n, 2.0), 20.0, np.full(n, 0.01), 3.0)
    lag = np.abs(time_s[:, None] - time_s[None, :])
    slow = rng.multivariate_normal(np.zeros(n), 4.0 * np.exp(-lag / 20.0), runs)
    grade = rng.multivariate_normal(np.zeros(n), 1e-4 * np.exp(-lag / 3.0), runs)
    climb = np.concatenate(
        [np.zeros((runs, 1)), np.cumsum(5.0 * (grade[:, 1:] + grade[:, :-1]), axis=1)], axis=1
    )
    errors = slow + climb + 0.3 * rng.normal(size=(runs, n))
    weights = line_weights(10.0 * time_s)
    expected = np.std(errors @ weights)
    modelled = np.sqrt(weights @ model.covariance(np.arange(n)) @ weights)
    assert modelled == pytest.approx(expected, rel=0.02)


def test_the_covariance_is_that_of_the_sums_written_as_matrices() -> None:
    rng = np.random.default_rng(4)
    n = 7
    time_s = np.cumsum(rng.uniform(0.3, 3.0, n))
    speed, white, slow, grade = rng.uniform(0.1, 3.0, (4, n))
    model = AltitudeErrors(time_s, speed, white, slow, 20.0, grade, 3.0)
    lag = np.abs(time_s[:, None] - time_s[None, :])
    rates = np.outer(grade * speed, grade * speed) * np.exp(-lag / 3.0)
    step = np.diff(time_s)
    sums = np.zeros((n, n))
    for k in range(1, n):
        sums[k:, k - 1 : k + 1] += step[k - 1] / 2
    expected = np.outer(slow, slow) * np.exp(-lag / 20.0) + np.diag(white**2) + sums @ rates @ sums.T
    assert model.covariance(np.arange(n)) == pytest.approx(expected, rel=1e-12)
    some = np.array([1, 2, 5])
    assert model.covariance(some)[0, 0] == pytest.approx(expected[1, 1] - sums[1] @ rates @ sums[1])
