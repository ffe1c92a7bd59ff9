"""Ways of driving along a street whose heights are known: standing, reversing, there and back, off the map."""

from __future__ import annotations

import itertools
import json
from dataclasses import fields, replace

import numpy as np
import pytest

from factor_support import roads, street
from fusion.errors import NoMatchError
from fusion.methods.base import DriveResult
from fusion.network.adjust import adjust
from fusion.network.pass_factor import PassFactor
from fusion.pipeline import run_drive
from fusion.profile.factors import MIN_CONFIDENCE
from fusion.roads.table import RoadTable
from fusion.types import DriveLog, Floats, GnssFix
from profile_support import Levels, hills, smoothed, street_log

START_S = 1.7e9
SIDE_M = 60.0
COUNT = 18
SEEDS = range(4)
STREET = street(*[SIDE_M] * COUNT)


def way(*legs: tuple[float, float], start_m: float = 0.5) -> tuple[Floats, Floats]:
    """(time, distance) once a second of a vehicle that goes at these speeds for so many seconds each."""
    speed = np.concatenate([np.full(int(seconds), mps) for mps, seconds in legs])
    eased = np.convolve(np.pad(speed, (4, 4), mode="edge"), np.ones(9) / 9, "valid")
    along = start_m + np.concatenate([[0.0], np.cumsum(0.5 * (eased[1:] + eased[:-1]))])
    return START_S + np.arange(float(len(along))), along


def true_slopes(table: RoadTable = STREET) -> Floats:
    """Regression of height on distance over each segment, %."""
    ends = np.concatenate([[0.0], np.cumsum(table.length_m)])
    parts = (np.linspace(a, b, 200) for a, b in itertools.pairwise(ends))
    return np.array([100 * np.polyfit(x, hills(x), 1)[0] for x in parts])


def run(log: DriveLog, table: RoadTable = STREET) -> tuple[Floats, Floats, DriveResult]:
    """Errors and sigmas by segment (NaN without a slope), and the result in the table's rows."""
    network, result = run_drive(log, table, None)
    assert network.table.osm_way_id.tolist() == table.osm_way_id.tolist()
    error, sigma, true = np.full(len(table), np.nan), np.full(len(table), np.nan), true_slopes(table)
    for s in result.slopes:
        error[s.segment], sigma[s.segment] = s.slope_percent - true[s.segment], s.slope_sigma_percent
    return error, sigma, result


def root(error: Floats) -> float:
    return float(np.sqrt(np.nanmean(error**2)))


ALONG = way((10.0, 107))
"""Once from end to end."""


def pooled(way_: tuple[Floats, Floats], **options: object) -> tuple[Floats, Floats, list[DriveResult]]:
    """Errors and sigmas over some seeds, of the segments driven whole."""
    errors, sigmas, results = [], [], []
    for seed in SEEDS:
        log = street_log(*way_, hills, np.random.default_rng(seed), **options)  # type: ignore[arg-type]
        error, sigma, result = run(log)
        errors.append(error[1:-2])
        sigmas.append(sigma[1:-2])
        results.append(result)
    return np.array(errors), np.array(sigmas), results


@pytest.fixture(scope="module")
def once() -> tuple[Floats, Floats, list[DriveResult]]:
    return pooled(ALONG)


def test_a_plain_drive_is_good(once: tuple[Floats, Floats, list[DriveResult]]) -> None:
    error, sigma, results = once
    assert np.isfinite(error).all()
    assert root(error) < 0.6
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.88
    for result in results:
        assert not result.report["warnings"]
        assert {s.passes for s in result.slopes} == {1}


CALM = Levels(0.0, 0.0, 0.0, 0.0, springs=0.0, force=0.0, position_m=0.0, mount=0.0)


def test_a_log_without_noise_gives_the_road_itself() -> None:
    """What is left is the method's own error: knots, times between epochs, the way along the street."""
    error, sigma, _ = run(street_log(*ALONG, hills, np.random.default_rng(0), levels=CALM))
    assert root(error[1:-2]) < 0.1
    assert np.all(np.abs(error[1:-2]) < 3 * sigma[1:-2])
    assert np.median(sigma[1:-2]) < 0.4


@pytest.mark.slow
def test_standing_for_minutes_changes_nothing(once: tuple[Floats, Floats, list[DriveResult]]) -> None:
    """Five minutes at a barrier, while the receiver's height wanders by metres."""
    error, sigma, results = pooled(way((10.0, 53), (0.0, 300), (10.0, 55)))
    assert np.isfinite(error).all()
    assert root(error) < 1.2 * root(once[0])
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.88
    for result in results:
        assert {s.passes for s in result.slopes} == {1}
        assert not result.report["breaks"]


@pytest.mark.slow
def test_reversing_a_few_metres_does_no_harm(once: tuple[Floats, Floats, list[DriveResult]]) -> None:
    """A car that backs up by some 10 m, nose forward all the time."""
    error, sigma, _ = pooled(way((10.0, 50), (0.0, 15), (-2.0, 12), (0.0, 10), (10.0, 58)))
    assert np.isfinite(error).all()
    assert root(error) < 1.3 * root(once[0])
    assert np.mean(np.abs(error) < 1.96 * sigma) > 0.88


def alone(passes: list[PassFactor]) -> Floats:
    """What some passes over the street say without the others, %; by row."""
    return adjust(STREET, {0: passes}).slope_percent


THERE_AND_BACK = way((10.0, 100), (0.0, 12), (-10.0, 100))


@pytest.mark.slow
def test_there_and_back_agree_in_sign(once: tuple[Floats, Floats, list[DriveResult]]) -> None:
    """Slopes count from from_node to to_node, whichever way the vehicle goes."""
    time, along = THERE_AND_BACK
    nose = np.where(time - START_S < 106, 1.0, -1.0)
    for seed in SEEDS:
        log = street_log(time, along, hills, np.random.default_rng(seed), nose=nose)
        error, sigma, result = run(log)
        known = slice(1, -4)
        assert root(error[known]) < root(once[0])
        assert {s.passes for s in result.slopes[1:-4]} == {2}
        assert np.mean(np.abs(error[known]) < 1.96 * sigma[known]) > 0.8
        back = alone([f for f in result.factors if f.first_time_s - START_S > 120])
        there = alone([f for f in result.factors if f.last_time_s - START_S < 95])
        assert np.corrcoef(back[1:12], there[1:12])[0, 1] > 0.95


@pytest.mark.slow
def test_back_in_reverse_gear(once: tuple[Floats, Floats, list[DriveResult]]) -> None:
    """The nose looks up the street all the time: attitude and accelerometer must not be taken for the way driven."""
    time, along = way((10.0, 100), (0.0, 12), (-4.0, 220))
    errors = []
    for seed in SEEDS:
        log = street_log(time, along, hills, np.random.default_rng(seed))
        error, sigma, result = run(log)
        errors.append(error[3:-4])
        assert np.mean(np.abs(error[3:-4]) < 1.96 * sigma[3:-4]) > 0.8
        assert not result.report["mount"]["moves"], "the mount did not move, the car reversed"
    assert root(np.array(errors)) < root(once[0])


def test_parts_of_segments_at_the_ends_are_used_and_counted() -> None:
    """From 40 m into the first of eight segments to 20 m into the last."""
    table = street(*[SIDE_M] * 8)
    log = street_log(*way((10.0, 41), start_m=40.0), hills, np.random.default_rng(3))
    error, sigma, result = run(log, table)
    assert np.isfinite(error).all()
    assert result.report["passes"] == 8
    assert result.report["passes_of_part_of_a_segment"] == 2
    first, last = result.factors[0], result.factors[-1]
    assert first.start_m == pytest.approx(40, abs=5)
    assert first.end_m == pytest.approx(SIDE_M, abs=0.1)
    assert last.start_m == pytest.approx(0, abs=0.1)
    assert last.end_m == pytest.approx(20, abs=5)
    # The slope is the whole segment's, whatever part of it was driven, with the sigma that this deserves.
    assert np.all(np.abs(error[[0, -1]]) < 3 * sigma[[0, -1]])
    assert np.min(sigma[[0, -1]]) > 1.3 * np.median(sigma[1:-1])


def test_a_stretch_off_the_map_is_a_break() -> None:
    """The middle third of the street is missing from the map, and nothing is made up across it."""
    here = np.r_[0:6, 12:COUNT]
    table = STREET.subset(here)
    aside = np.where((ALONG[1] > 6.2 * SIDE_M) & (ALONG[1] < 11.8 * SIDE_M), 120.0, 0.0)
    log = street_log(*ALONG, hills, np.random.default_rng(4), aside_m=aside)
    _, result = run_drive(log, table, None)
    assert len(result.report["breaks"]) >= 1
    assert {s.segment for s in result.slopes} == set(range(len(table)))
    rows = np.array([s.segment for s in result.slopes])
    error = np.array([s.slope_percent for s in result.slopes]) - true_slopes()[here][rows]
    whole = np.isin(here[rows], [*range(1, 5), *range(13, COUNT - 2)])
    assert root(error[whole]) < 1.0
    track = result.track
    off = (track.time_s - START_S > 6.6 * SIDE_M / 10) & (track.time_s - START_S < 11.4 * SIDE_M / 10)
    assert not np.any(track.segment[off] >= 0)
    after = np.flatnonzero(track.time_s - START_S > 11.4 * SIDE_M / 10)[0]
    assert track.after_outage[after]
    gap_s = 11.8 * SIDE_M / 10 - 6.2 * SIDE_M / 10
    waits = [b.first_time_s - a.last_time_s for a, b in itertools.pairwise(result.factors)]
    assert np.sum(np.array(waits) > 0.8 * gap_s) == 1, "heights go on across the break for as long as it took"


def test_the_same_segment_twice_has_two_passes() -> None:
    time, along = THERE_AND_BACK
    nose = np.where(time - START_S < 106, 1.0, -1.0)
    _, _, result = run(street_log(time, along, hills, np.random.default_rng(1), nose=nose))
    twice = [s for s in result.slopes if s.passes == 2]
    assert len(twice) >= 14
    for s in twice:
        own = [f for f in result.factors if f.segment == s.segment]
        assert len(own) == 2
        assert s.observations == sum(f.observations for f in own)
        assert (s.first_time_s, s.last_time_s) == (own[0].first_time_s, own[1].last_time_s)
    assert result.report["passes"] == len(result.factors)


def parked(log: DriveLog) -> DriveLog:
    """Where roads are within the log's surroundings, but never beneath it."""
    fix = log.fix
    columns = {f.name: getattr(fix, f.name) for f in fields(GnssFix)}
    return DriveLog("csv", GnssFix(**(columns | {"lat_deg": fix.lat_deg + 180 / 111_320})))


def test_a_log_that_never_touches_a_road_says_so() -> None:
    log = parked(street_log(*ALONG, hills, np.random.default_rng(0)))
    with pytest.raises(NoMatchError, match=r"[Ii]mport the roads of that area.*\.$"):
        run_drive(log, STREET, None)


def test_the_same_log_gives_the_same_bits_and_stays_as_it_is() -> None:
    log = street_log(*ALONG, hills, np.random.default_rng(5))
    copies = {
        name: {f.name: getattr(table, f.name).copy() for f in fields(table)}
        for name, table in log.tables().items()
    }
    street_before = {f.name: np.copy(getattr(STREET, f.name)) for f in fields(STREET)}
    first, second = run_drive(log, STREET, None)[1], run_drive(log, STREET, None)[1]
    assert first.slopes == second.slopes
    assert [f.encode() for f in first.factors] == [f.encode() for f in second.factors]
    assert json.dumps(first.report) == json.dumps(second.report)
    for name, table in log.tables().items():
        for column, before in copies[name].items():
            np.testing.assert_array_equal(getattr(table, column), before, err_msg=f"{name}.{column}")
    for name, before in street_before.items():
        np.testing.assert_array_equal(getattr(STREET, name), before, err_msg=name)


def test_no_time_but_the_log_s_own_matters() -> None:
    """The same drive a year later gives the same slopes."""
    log = street_log(*ALONG, hills, np.random.default_rng(6))
    year = 365.25 * 86_400.0
    later = replace(
        log,
        **{name: replace(table, time_s=table.time_s + year) for name, table in log.tables().items()},  # type: ignore[arg-type]
    )
    one, other = run(log), run(later)
    np.testing.assert_allclose(one[0], other[0], atol=0.01)
    np.testing.assert_allclose(one[1], other[1], rtol=0.02)


def test_progress_grows() -> None:
    said: list[tuple[str, float]] = []
    run_drive(
        street_log(*ALONG, hills, np.random.default_rng(0)),
        STREET,
        None,
        progress=lambda stage, share: said.append((stage, share)),
    )
    shares = [share for _, share in said]
    assert shares == sorted(shares)
    assert shares[0] >= 0
    assert shares[-1] == 1
    assert len(set(shares)) >= 4
    assert all(stage for stage, _ in said)


def test_work_can_be_stopped_from_progress() -> None:
    class StopError(Exception):
        pass

    def stop(stage: str, share: float) -> None:
        if share > 0.2:
            raise StopError(stage)

    with pytest.raises(StopError):
        run_drive(street_log(*ALONG, hills, np.random.default_rng(0)), STREET, None, progress=stop)


def test_uncertain_passes_say_little_or_nothing() -> None:
    """Two streets 6 m apart, and the vehicle between them: which of them it drove is anybody's guess."""
    points = {k + 10 * lane: (SIDE_M * k, 6.0 * lane) for lane in (0, 1) for k in range(7)}
    parallel = roads(points, [(k + 10 * lane, k + 1 + 10 * lane) for lane in (0, 1) for k in range(6)])
    log = street_log(*way((10.0, 36)), hills, np.random.default_rng(2), aside_m=3.0)
    match = smoothed(log, parallel).path.match
    assert np.all(match.confidence < 0.95), "no doubt, no test"
    report = run_drive(log, parallel, None)[1].report
    assert report["passes"] == np.count_nonzero(match.confidence >= MIN_CONFIDENCE)
    assert report["passes_dropped_as_uncertain"] == np.count_nonzero(match.confidence < MIN_CONFIDENCE)


def test_a_pause_that_the_log_states_gets_no_slopes() -> None:
    """Two tracks of a GPX file: what lies between them was perhaps never driven."""
    time, along = ALONG
    keep = (along < 5.5 * SIDE_M) | (along > 9.5 * SIDE_M)
    log = street_log(time[keep], along[keep], hills, np.random.default_rng(7))
    begins = time[keep][np.argmax(np.diff(time[keep], prepend=time[0]))]
    joined, _, _ = run(log)
    split, _, _ = run(replace(log, outages_s=np.array([begins])))
    assert np.isfinite(joined[5:10]).all(), "a mere gap in the recording is bridged"
    assert np.isnan(split[5:10]).all()
    assert np.isfinite(split[:5]).all() and np.isfinite(split[10:]).all()
