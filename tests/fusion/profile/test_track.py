"""The rows of a drive's track: at the times of its positions, whatever else was measured when."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from factor_support import street
from fusion.profile.measurements import ALTITUDE, build_measurements
from fusion.profile.model import GRADE, HEIGHT, build_smoother_epochs
from fusion.profile.noise import learn
from fusion.profile.prior import prior_of
from fusion.profile.report import build_track
from fusion.profile.traversals import SmoothedDrive
from profile_support import Levels, hills, smoothed, street_log

TABLE = street(*[60.0] * 20)
TIME_S = 1.7e9 + np.arange(110.0)
ALONG_M = 5 + 10 * (TIME_S - TIME_S[0])
CALM = Levels(0.0, 0.0, 0.0, 0.0, springs=0.0, force=0.0, position_m=0.0, mount=0.0)


def test_rows_lie_at_positions_though_attitudes_were_measured_between_them() -> None:
    log = street_log(TIME_S, ALONG_M, hills, np.random.default_rng(0), levels=CALM)
    between = replace(log.attitude, time_s=log.attitude.time_s + 0.37)
    one = smoothed(replace(log, attitude=between), TABLE)
    assert len(one.epochs.time_s) > 1.9 * len(TIME_S)
    track = build_track(one)
    np.testing.assert_array_equal(track.time_s, TIME_S)
    assert np.all(track.has_gnss)
    np.testing.assert_allclose(track.alt_m, hills(ALONG_M), atol=0.3)


def test_heights_that_are_late_leave_the_rows_at_the_positions() -> None:
    """Their epochs are 1.5 s before the positions, and the last of them are behind all epochs."""
    log = street_log(
        TIME_S,
        ALONG_M,
        hills,
        np.random.default_rng(0),
        levels=CALM,
        without=("velocity", "attitude", "force"),
    )
    late = replace(log.fix, alt_msl_m=hills(ALONG_M - 15.0))
    log = replace(log, fix=late)
    path = smoothed(log, TABLE).path
    measured = build_measurements(log, path, None, frozenset({ALTITUDE}), altitude_lag_s=1.5)
    epochs = build_smoother_epochs(measured, path)
    assert not np.isin(epochs.time_s, TIME_S).any()
    learned = learn(measured, epochs, prior_of(measured))
    track = build_track(SmoothedDrive(path, measured, epochs, learned))
    np.testing.assert_array_equal(track.time_s, TIME_S)
    height, grade = learned.smoothed.mean[:, HEIGHT], learned.smoothed.mean[:, GRADE]
    expected = np.append(np.interp(TIME_S[:-1], epochs.time_s, height), height[-1] + 15.0 * grade[-1])
    np.testing.assert_allclose(track.alt_m[1:-2], expected[1:-2])
    np.testing.assert_allclose(track.alt_m[-1], expected[-1], atol=0.05)


def test_through_an_outage_rows_lie_where_anything_was_measured() -> None:
    log = street_log(TIME_S, ALONG_M, hills, np.random.default_rng(0), levels=CALM)
    lost = (TIME_S - TIME_S[0] > 40) & (TIME_S - TIME_S[0] < 60)
    one = smoothed(replace(log, fix=log.fix.take(~lost)), TABLE)
    track = build_track(one)
    np.testing.assert_array_equal(track.time_s, TIME_S)
    np.testing.assert_array_equal(track.has_gnss, ~lost)
    assert np.all(np.isfinite(track.alt_m))
