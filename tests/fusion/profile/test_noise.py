"""Noise levels are learned from the drive: known levels, springs that two sensors share, sudden changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.profile.measurements import ALTITUDE, BARO, DOPPLER, FORCE, PITCH
from fusion.profile.model import (
    DRIFT,
    GRADE,
    MOUNT,
    Noise,
    decorrelated,
    linear_model,
    pitch_partner,
    white_variance,
)
from fusion.profile.noise import Learned, learn
from fusion.profile.prior import prior_of
from fusion.types import Floats
from model_drives import BIAS_GRADE, MOUNT_GRADE, TRUTHS, Simulated, simulate


@pytest.mark.slow
@pytest.mark.parametrize("truth", TRUTHS, ids=["smooth road", "ordinary", "poor receiver"])
def test_levels_are_recovered(truth: Noise) -> None:
    found = [simulate(seed, truth).learned().noise for seed in range(4)]
    for name in ("altitude_m", "doppler", "pitch", "force"):
        ratios = [getattr(noise, name) / getattr(truth, name) for noise in found]
        assert 1 / 1.3 < np.exp(np.mean(np.log(ratios))) < 1.3, (name, ratios)
    # A rate is a variance: 30 % of the step that it stands for.
    drift = [np.sqrt(noise.drift / truth.drift) for noise in found]
    assert 1 / 1.3 < np.exp(np.mean(np.log(drift))) < 1.3, drift
    roughness = [noise.roughness / truth.roughness for noise in found]
    assert 1 / 3 < np.exp(np.mean(np.log(roughness))) < 3, roughness


@pytest.mark.slow
@pytest.mark.parametrize(("white_m", "drift"), [(0.1, 4e-4), (0.3, 0.01), (1.0, 0.05)])
def test_a_barometer_s_levels_are_recovered(white_m: float, drift: float) -> None:
    """Of an hour: under gusts the least of these drifts shows in minutes only, and ten of them tell little of it."""
    truth = Noise(roughness=1e-5, doppler=1.0, baro_m=white_m, baro_drift=drift)
    found = [
        simulate(seed, truth, sensors=(DOPPLER, BARO), seconds=3600).learned().noise for seed in range(4)
    ]
    level = [noise.baro_m / white_m for noise in found]
    rate = [np.sqrt(noise.baro_drift / drift) for noise in found]
    assert 1 / 1.3 < np.exp(np.mean(np.log(level))) < 1.3, level
    assert 1 / 1.3 < np.exp(np.mean(np.log(rate))) < 1.3, rate


def test_what_the_log_states_does_not_decide() -> None:
    """Stated accuracies ten times too good and ten times too bad lead to the same levels."""
    one = simulate(1, TRUTHS[1])
    found = []
    for factor in (0.1, 1.0, 10.0):
        noise = learn(
            replace(one.measured, stated_sigma=factor * one.measured.stated_sigma),
            one.epochs,
            prior_of(replace(one.measured, stated_sigma=factor * one.measured.stated_sigma)),
        ).noise
        found.append((noise.altitude_m, noise.doppler * factor, np.sqrt(noise.drift), noise.pitch))
    assert np.all(np.abs(np.log(np.array(found) / found[1])) < np.log(1.35)), found


def scores(one: Simulated, learned: Learned) -> np.ndarray:
    """Errors of the smoothed grade in sigmas, every 10 s."""
    sigma = np.sqrt(learned.smoothed.variance[:, GRADE])
    return np.asarray((learned.smoothed.mean[:, GRADE] - one.grade) / sigma)[5::10]


@pytest.mark.slow
@pytest.mark.parametrize(("springs", "low", "high"), [(0.012, 0.88, 1.01), (0.0, 0.5, 0.88)])
def test_errors_that_pitch_and_force_share_count_once(springs: float, low: float, high: float) -> None:
    """Both ride on the same springs: two sensors, one error. Where each has its own, two know more than one."""
    own = 0.002 if springs else 0.012
    truth = Noise(roughness=3e-6, pitch=own, force=own, altitude_m=0.5, drift=0.15, wander=1e-6)
    both: list[float] = []
    one: list[float] = []
    inside = []
    for seed in range(6):
        drive = simulate(seed, truth, sensors=(ALTITUDE, PITCH, FORCE), springs=springs)
        learned = drive.learned()
        assert (learned.noise.shared > 0.5) == (springs > 0)
        inside.append(np.abs(scores(drive, learned)) < 1.96)
        noise = learned.noise
        level = float(np.hypot(springs, own))
        for sigmas, known in ((both, noise), (one, noise.with_(shared=0.0, pitch=level, force=1e3))):
            variance = white_variance(drive.measured, known)
            by = linear_model(drive.measured, drive.epochs, known, variance).smooth()
            sigmas.append(float(np.sqrt(np.median(by.variance[:, GRADE]))))
    assert low < np.mean(both) / np.mean(one) < high
    assert np.mean(np.concatenate(inside)) > 0.8


def test_independent_errors_are_not_taken_for_shared_ones() -> None:
    found = [simulate(seed, Noise(pitch=0.012, force=0.012)).learned().noise.shared for seed in range(3)]
    assert max(found) < 0.3


def test_decorrelated_rows_have_independent_errors() -> None:
    one = simulate(3, Noise(pitch=0.004, force=0.004), springs=0.01)
    noise = Noise(shared=0.01**2 / (0.01**2 + 0.004**2))
    clean, share = decorrelated(one.measured, noise)
    partner = pitch_partner(one.measured)
    force = np.flatnonzero(one.measured.sensor == FORCE)
    np.testing.assert_array_equal(partner[one.measured.sensor != FORCE], -1)
    np.testing.assert_array_equal(one.measured.sensor[partner[force]], PITCH)
    np.testing.assert_array_equal(one.measured.time_s[partner[force]], one.measured.time_s[force])
    np.testing.assert_array_equal(share[force], noise.shared)
    assert not share[one.measured.sensor != FORCE].any()
    error = clean.value[force] - (1 - noise.shared) * (one.grade + MOUNT_GRADE) - BIAS_GRADE
    pitch = one.measured.value[partner[force]] - one.grade - MOUNT_GRADE
    assert abs(np.corrcoef(error, pitch)[0, 1]) < 0.1
    assert np.corrcoef(error + noise.shared * pitch, pitch)[0, 1] > 0.7


@pytest.mark.parametrize(("lag_s", "apart_m"), [(0.4, 0.0), (0.1, 20.0)])
def test_a_pitch_too_far_away_is_no_partner(lag_s: float, apart_m: float) -> None:
    two = simulate(1, TRUTHS[1], sensors=(PITCH, FORCE), seconds=50).measured
    later = two.sensor == FORCE
    moved = replace(two, time_s=two.time_s + lag_s * later, along_m=two.along_m + apart_m * later)
    assert np.all(pitch_partner(moved) == -1)
    assert np.all(pitch_partner(two)[later] >= 0)


@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
@pytest.mark.parametrize("degrees", [2.5, -2.5])
def test_a_mount_that_moves_is_found_where_it_does(share: float, degrees: float) -> None:
    moved = simulate(7, TRUTHS[1], mount_step=(share, float(np.tan(np.radians(degrees)))))
    learned = moved.learned()
    times = [moved.epochs.time_s[k] for k, state in learned.jumps if state == MOUNT]
    assert len(times) == 1
    assert abs(times[0] - share * 600) <= 4
    before, after = learned.smoothed.mean[[int(share * 600) - 20, int(share * 600) + 20], MOUNT]
    sigma = np.sqrt(learned.smoothed.variance[:, MOUNT].max())
    assert abs(after - before - np.tan(np.radians(degrees))) < 4 * sigma
    assert np.mean(np.abs(scores(moved, learned)) < 2.6) > 0.9


def test_a_height_that_jumps_is_found_where_it_does() -> None:
    moved = simulate(8, TRUTHS[1], height_step=(0.5, 30.0))
    learned = moved.learned()
    times = [moved.epochs.time_s[k] for k, state in learned.jumps if state == DRIFT]
    assert any(abs(t - 300) <= 2 for t in times)
    assert np.mean(np.abs(scores(moved, learned)) < 1.96) > 0.85


@pytest.mark.slow
@pytest.mark.parametrize(("tails", "allowed"), [(False, 0), (True, 1)], ids=["gauss", "student"])
def test_steady_drives_have_no_sudden_changes(tails: bool, allowed: int) -> None:
    """With tails far heavier than any receiver's (three degrees of freedom) one drive in ten may look so."""
    found = [simulate(seed, TRUTHS[seed % 3], seconds=400, tails=tails).learned().jumps for seed in range(10)]
    assert sum(1 for jumps in found if jumps) <= allowed, found


def test_wild_values_are_outliers_and_do_little() -> None:
    one = simulate(5, TRUTHS[1])
    rng = np.random.default_rng(0)
    wild = rng.choice(np.flatnonzero(one.measured.sensor == DOPPLER), 30, replace=False)
    value = one.measured.value.copy()
    value[wild] += rng.choice([-1, 1], 30) * 0.3
    before = one.learned()
    after = learn(replace(one.measured, value=value), one.epochs, prior_of(one.measured))
    assert np.mean(after.outlier[wild]) > 0.9
    assert before.outlier.sum() < 0.01 * len(one.measured)
    others = np.setdiff1d(np.arange(len(one.measured)), wild)
    assert after.outlier[others].sum() < 0.01 * len(one.measured)
    moved = after.smoothed.mean[:, GRADE] - before.smoothed.mean[:, GRADE]
    assert np.sqrt(np.mean(moved**2)) < np.sqrt(np.mean(before.smoothed.variance[:, GRADE]))


def test_errors_that_repeat_weigh_less() -> None:
    """At two epochs a second springs and filters let neighbouring errors repeat: two are hardly more than one."""
    one = simulate(6, Noise(roughness=1e-6, pitch=0.004, force=0.006))
    quick = replace(one.measured, time_s=0.5 * one.measured.time_s)
    epochs = replace(one.epochs, time_s=0.5 * one.epochs.time_s)
    doppler = np.flatnonzero(quick.sensor == DOPPLER)
    white = 0.01 * np.random.default_rng(1).normal(size=len(doppler) + 1)
    found = []
    for error in (white[1:], (white[1:] + white[:-1]) / np.sqrt(2)):
        value = quick.value.copy()
        value[doppler] = one.grade[one.epochs.of_measurement[doppler]] + error
        measured = replace(quick, value=value)
        learned = learn(measured, epochs, prior_of(measured))
        found.append(float(np.mean(learned.variance[doppler]) / learned.noise.doppler**2))
    assert found[1] > 1.7 * found[0]


def test_a_short_drive_stays_near_where_learning_starts() -> None:
    """Ten measurements prove nothing: levels keep within a factor of two of the log's word."""
    short = simulate(9, TRUTHS[1], seconds=5, sensors=(ALTITUDE, DOPPLER))
    start, found = prior_of(short.measured).noise, short.learned().noise
    for name in ("altitude_m", "doppler"):
        assert 0.5 < getattr(found, name) / getattr(start, name) < 2, name
    assert not short.learned().jumps


def filtered(height: Floats, tau_s: float) -> Floats:
    """Heights at 1 Hz behind a filter that looks both ways: none is late."""
    keep = np.exp(-1 / tau_s)
    for _ in range(2):
        out = height.copy()
        for k in range(1, len(out)):
            out[k] = keep * out[k - 1] + (1 - keep) * height[k]
        height = out[::-1]
    return height


@pytest.mark.slow
@pytest.mark.parametrize(("truth", "bound"), [(TRUTHS[0], 1.6), (TRUTHS[1], 1.6), (TRUTHS[2], 2.4)])
def test_heights_that_a_filter_has_smoothed_are_not_taken_for_errorless(truth: Noise, bound: float) -> None:
    """Their grades' sigmas stay nearer to what they err by than by neighbouring heights alone.

    Of a poor receiver on hilly roads errors and road look too much alike: half of what is needed.
    """
    z: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(6):
        one = simulate(seed, truth, sensors=(ALTITUDE,))
        measured = replace(one.measured, value=filtered(one.measured.value, 2.0))
        for by_satellites, found in z.items():
            by = learn(measured, one.epochs, prior_of(measured), by_satellites=by_satellites).smoothed
            error = by.mean[:, GRADE] - one.grade
            found.append(np.mean(error**2 / by.variance[:, GRADE]))
    assert np.sqrt(np.mean(z[True])) < 0.85 * np.sqrt(np.mean(z[False]))
    assert np.sqrt(np.mean(z[True])) < bound


def test_heights_of_a_receiver_without_a_filter_are_learned_from_one_to_the_next() -> None:
    one = simulate(3, TRUTHS[1], sensors=(ALTITUDE,))
    found = [
        learn(one.measured, one.epochs, prior_of(one.measured), by_satellites=by).noise
        for by in (True, False)
    ]
    assert found[0] == found[1]
