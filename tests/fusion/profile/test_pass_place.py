"""Where a pass lies along the road is the pass's own unknown; what its heights tell from one end to the other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.network.pass_factor import EAST, ENTRY, EXIT, NORTH, NUISANCES, PLACE_PART_S, PLACE_TAU_S
from fusion.profile.factors import PLACE_BOUND_M, place_sigma
from fusion.profile.measurements import ALTITUDE, BARO
from fusion.profile.model import DRIFT, GRADE, decorrelated
from fusion.profile.traversals import (
    PLACE_SIGMA_M,
)
from profile_support import smoothed
from street_drives import (
    TABLE,
    TIME_S,
    data_of,
    drive_log,
    factors_of,
    own_measurements,
)


@pytest.mark.parametrize("kind", ["everything", "back again"])
def test_a_pass_that_lies_elsewhere_sees_what_the_road_is_there(kind: str) -> None:
    """Farther along by so much heights change by the grade, and grades by the bend, in the direction of the path."""
    one = smoothed(drive_log(kind), TABLE)
    data, measured, path = data_of(one), one.measured, one.path
    _, share = decorrelated(measured, one.learned.noise)
    epochs, grade = one.epochs, one.learned.smoothed.mean[:, GRADE]
    for k in range(len(path.match)):
        lasted_s = float(path.match.leave_time_s[k] - path.match.enter_time_s[k])
        # What every fix of this log states, along one axis, as far as it changes within the pass.
        sigma_m = 2.0 / np.sqrt(2) * np.sqrt(1 - np.exp(-lasted_s / PLACE_TAU_S))
        for at, i in enumerate(own_measurements(one, k).tolist(), start=int(data.first[k])):
            here = measured.along_m[i]
            if measured.sensor[i] in (ALTITUDE, BARO):
                expected = np.interp(here, epochs.along_m, grade)
            else:
                near = np.interp([here - 10, here + 10], epochs.along_m, grade)
                expected = (1 - share[i]) * (near[1] - near[0]) / 20
            assert data.passing[at, 1] == pytest.approx(sigma_m * expected, abs=1e-9)
            # The rest is what its part of the drive has in common, along the street, which leads east.
            common_m = (
                2.0 / np.sqrt(2) * np.exp(-lasted_s / 2 / PLACE_TAU_S) * (1 if path.match.forward[k] else -1)
            )
            assert data.constants[at, EAST] == pytest.approx(common_m * expected, rel=1e-6, abs=1e-9)
            assert data.constants[at, NORTH] == pytest.approx(0.0, abs=1e-4)


def test_place_is_as_sure_as_the_fixes_say_along_one_axis() -> None:
    """On passes that last so long that nothing is left of the place before them."""
    one = smoothed(drive_log("everything"), TABLE)
    match, fix = one.path.match, one.fix
    slow = replace(match, leave_time_s=match.leave_time_s + 100 * PLACE_TAU_S)
    slow = replace(slow, enter_time_s=slow.enter_time_s - 100 * PLACE_TAU_S)
    one = replace(one, path=replace(one.path, match=slow))
    n = len(match)
    stated, common = place_sigma(one.path, replace(fix, h_acc_m=np.linspace(2.0, 8.0, len(fix.time_s))))
    middle = 0.5 * (one.path.match.enter_time_s + one.path.match.leave_time_s)
    expected = np.interp(middle, fix.time_s, np.linspace(2.0, 8.0, len(fix.time_s))) / np.sqrt(2)
    assert stated == pytest.approx(expected)
    assert common == pytest.approx(np.zeros((n, 2)))
    unknown = np.full(len(fix.time_s), np.nan)
    assert place_sigma(one.path, replace(fix, h_acc_m=unknown))[0].tolist() == [PLACE_SIGMA_M] * n
    # Fixes that state nothing are bridged by their neighbours.
    some = np.where(np.arange(len(unknown)) % 3 == 0, 4.0, np.nan)
    assert place_sigma(one.path, replace(fix, h_acc_m=some))[0] == pytest.approx(np.full(n, 4.0 / np.sqrt(2)))
    absurd, _ = place_sigma(one.path, replace(fix, h_acc_m=np.full(len(unknown), 500.0)))
    assert absurd.tolist() == [PLACE_BOUND_M] * n


def test_a_short_pass_lies_where_its_neighbours_do() -> None:
    one = smoothed(drive_log("everything"), TABLE)
    lasted_s = one.path.match.leave_time_s - one.path.match.enter_time_s
    sigma, common = place_sigma(one.path, one.fix)
    assert np.hypot(sigma, np.hypot(*common.T)) == pytest.approx(np.full(len(sigma), np.sqrt(2)))
    assert np.all(sigma < 2.0 / np.sqrt(2) * np.sqrt(lasted_s / PLACE_TAU_S))
    assert np.all(sigma > 0.9 * 2.0 / np.sqrt(2) * np.sqrt(lasted_s / (lasted_s + PLACE_TAU_S)))


def test_passes_of_half_a_minute_have_their_place_in_common() -> None:
    one = smoothed(drive_log("everything"), TABLE)
    found = factors_of(one)
    begin_s = float(one.path.match.enter_time_s.min())
    for factor in found:
        middle_s = 0.5 * (factor.first_time_s + factor.last_time_s) - begin_s
        assert factor.place == int(middle_s // PLACE_PART_S)
    assert len({f.place for f in found}) > 1


def test_a_height_that_jumped_on_a_pass_tells_nothing_across() -> None:
    """A pass of three seconds knows how its height's error goes on, unless it jumped in between."""
    one = smoothed(drive_log("jump"), TABLE)
    # A place that is not known shifts both ends alike: of its own it joins them somewhat.
    one = replace(one, fix=replace(one.fix, h_acc_m=np.full(len(one.fix.time_s), 0.01)))
    jumps = [float(one.epochs.time_s[k]) for k, state in one.learned.jumps if state == DRIFT]
    assert jumps == [TIME_S[51]]
    k = int(np.searchsorted(one.epochs.time_s, TIME_S[94]))
    jumped = replace(one, learned=replace(one.learned, jumps=((k, DRIFT),)))
    ends = [ENTRY.start, EXIT.start]
    for drive, loose in ((jumped, True), (one, False)):
        (crossed,) = (f for f in factors_of(drive) if f.first_time_s < TIME_S[94] <= f.last_time_s)
        both = crossed.information[-NUISANCES:, -NUISANCES:][np.ix_(ends, ends)]
        joint = abs(both[0, 1]) / np.sqrt(both[0, 0] * both[1, 1])
        assert (joint < 0.01) == loose, (joint, loose)
