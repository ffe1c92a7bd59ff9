"""Corrections by a base: what two receivers share goes, what is each one's own stays, and bases that are of no use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import MalformedLogError
from fusion.frames import local_axes
from fusion.gnss.differential import FEWEST, corrections_of
from fusion.gnss.measure import measure
from fusion.gnss.measurements import Measurements, Solution
from fusion.published.positioning.relative import relative_positions
from fusion.signals import GALILEO, GPS, RawGnss
from fusion.types import Floats, no_progress
from gnss_support import BERLIN_M, TOE_S, even_sky, measured, with_clock_steps

TIMES_S = TOE_S + np.arange(0.0, 300.0, 5.0)
COUNT = len(TIMES_S)
EAST_NORTH_UP = local_axes(BERLIN_M[None])[0]
BASE_M = BERLIN_M + EAST_NORTH_UP.T @ [6_000.0, -4_000.0, 20.0]
ROVER_M = BERLIN_M + np.outer(TIMES_S - TOE_S, EAST_NORTH_UP.T @ [8.0, 6.0, 0.1])


def with_common(raw: RawGnss, scale: float = 4.0) -> RawGnss:
    """The same with errors of satellites that all receivers see, which change slowly."""
    signals = raw.signals
    key = 40 * signals.system + signals.number
    wrong = scale * np.sin(7.0 * key) + 0.004 * np.cos(3.0 * key) * (signals.gps_s[signals.epoch] - TOE_S)
    return replace(raw, signals=replace(signals, pseudorange_m=signals.pseudorange_m + wrong))


def receiver(place_m: Floats, *systems: int, clock_m: float = 900.0) -> RawGnss:
    return with_common(
        measured(even_sky(*systems), TIMES_S, place_m, np.full(COUNT, clock_m), bias_m={GALILEO: 12.0})
    )


@pytest.fixture(scope="module")
def base() -> RawGnss:
    raw = receiver(np.tile(BASE_M, (COUNT, 1)), GPS, GALILEO, clock_m=-400.0)
    return replace(raw, place_m=BASE_M)


@pytest.fixture(scope="module")
def rover() -> RawGnss:
    return receiver(ROVER_M, GPS, GALILEO)


def quietly(raw: RawGnss) -> Measurements:
    return measure(raw, no_progress)


def left_m(made: Measurements) -> Floats:
    """What pseudoranges of the rover are wrong by, beside a clock for each epoch and a bias for each system, (n,)."""
    left = made.pseudorange_m - np.linalg.norm(made.satellite_m - ROVER_M[made.epoch], axis=1)
    for _ in range(3):
        for label in (made.epoch, made.group):
            left = left - (np.bincount(label, left) / np.maximum(np.bincount(label), 1))[label]
    return np.asarray(left)


def test_errors_that_both_receivers_share_are_taken_off(base: RawGnss, rover: RawGnss) -> None:
    alone, by_base = quietly(rover), quietly(rover.beside(base))
    assert left_m(alone).std() > 2.0
    assert np.abs(left_m(by_base)).max() < 0.3  # 7 km apart, at five degrees of elevation
    assert by_base.counts["corrected by the base"] == len(by_base.satellite)


def test_a_receiver_corrects_itself(rover: RawGnss) -> None:
    """Its noise is averaged, and so stays; what lasts goes."""
    still = receiver(np.tile(BASE_M, (COUNT, 1)), GPS)
    made = quietly(still.beside(replace(still, place_m=BASE_M)))
    off = made.pseudorange_m - np.linalg.norm(made.satellite_m - BASE_M, axis=1)
    of_clock = np.bincount(made.epoch, off) / np.bincount(made.epoch)
    assert np.abs(off - of_clock[made.epoch]).max() < 0.05


@settings(max_examples=15, deadline=None)
@given(steps=st.lists(st.floats(-40, 40), min_size=COUNT, max_size=COUNT))
def test_the_clock_of_the_base_says_nothing(steps: list[float]) -> None:
    raw = receiver(np.tile(BASE_M, (COUNT, 1)), GPS)
    before = corrections_of(quietly(raw), BASE_M)
    after = corrections_of(quietly(with_clock_steps(raw, np.array(steps))), BASE_M)
    assert after.names == before.names
    np.testing.assert_allclose(after.value_m, before.value_m, atol=1e-3)


def test_noise_of_the_base_is_averaged(base: RawGnss, rover: RawGnss) -> None:
    noise = np.random.default_rng(4).normal(0, 3.0, len(base.signals.system))
    noisy = replace(base, signals=replace(base.signals, pseudorange_m=base.signals.pseudorange_m + noise))
    assert left_m(quietly(rover.beside(noisy))).std() < 1.2


def test_satellites_that_the_base_does_not_know_are_left_out(base: RawGnss, rover: RawGnss) -> None:
    of_gps = replace(base, signals=base.signals.take_rows(base.signals.system == GPS))
    made = quietly(rover.beside(of_gps))
    assert {name[0] for name in np.array(made.names)[made.satellite]} == {"G"}
    assert made.counts["unknown to the base"] > 0
    assert len(made) == COUNT


def test_epochs_without_the_base_stay_as_they_were(base: RawGnss, rover: RawGnss) -> None:
    early = base.signals.gps_s[base.signals.epoch] < TIMES_S[20]
    made = quietly(rover.beside(replace(base, signals=base.signals.take_rows(early))))
    alone = quietly(rover)
    late = made.time_s[made.epoch] > made.time_s[20] + 61.0
    there = alone.time_s[alone.epoch] > alone.time_s[20] + 61.0
    np.testing.assert_array_equal(made.pseudorange_m[late], alone.pseudorange_m[there])
    uncorrected = COUNT - 20 - 12
    assert f"for {uncorrected} of {COUNT} epochs" in made.warnings[-1]


def test_few_satellites_do_not_correct(base: RawGnss, rover: RawGnss) -> None:
    known = np.unique(base.signals.number[base.signals.system == GPS])[: FEWEST - 1]
    few = base.signals.take_rows((base.signals.system == GPS) & np.isin(base.signals.number, known))
    with pytest.raises(MalformedLogError, match="no usable pseudorange"):
        quietly(rover.beside(replace(base, signals=few)))


@pytest.mark.parametrize(
    ("place_m", "said"),
    [(None, "does not say where"), (BASE_M + np.array([900.0, 0.0, 0.0]), "0.9 km from where")],
)
def test_a_base_that_is_nowhere_or_elsewhere_is_refused(
    base: RawGnss, rover: RawGnss, place_m: Floats | None, said: str
) -> None:
    with pytest.raises(MalformedLogError, match=said):
        quietly(rover.beside(replace(base, place_m=place_m)))


def test_a_base_far_away_is_said(rover: RawGnss) -> None:
    away_m = BERLIN_M + EAST_NORTH_UP.T @ [150_000.0, 0.0, 0.0]
    far = replace(receiver(np.tile(away_m, (COUNT, 1)), GPS), place_m=away_m)
    assert " km away: the air above it is another's" in quietly(rover.beside(far)).warnings[-1]


def solution(position_m: Floats) -> Solution:
    n = len(position_m)
    return Solution(
        position_m,
        np.zeros((n, 3)),
        np.zeros((n, 6, 6)),
        np.zeros(n),
        np.empty(0),
        np.empty(0),
        np.zeros(n, bool),
    )


def test_as_printed_the_bases_error_of_place_is_added() -> None:
    error_m = np.column_stack([np.linspace(0, 5, COUNT), np.full(COUNT, -3.0), np.full(COUNT, 8.0)])
    base, rover = solution(BASE_M + error_m), solution(ROVER_M + error_m)
    moved = relative_positions(rover, TIMES_S, base, TIMES_S, BASE_M)
    np.testing.assert_allclose(moved.position_m, ROVER_M, atol=1e-6)
    later = relative_positions(rover, TIMES_S + 1000.0, base, TIMES_S, BASE_M)
    assert np.isnan(later.position_m).all()
    nothing = solution(np.full((COUNT, 3), np.nan))
    assert np.isnan(relative_positions(rover, TIMES_S, nothing, TIMES_S, BASE_M).position_m).all()
