"""What was measured on a segment, on the segment that it has become."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dense_adjustment import slope_row, smoothness
from fusion.network.condensed import CondensedPasses
from fusion.network.curve import grade_rows, height_rows, interval_count
from fusion.network.drive_constants import ConstantsInformation
from fusion.network.pass_factor import NUISANCES, PassFactor
from fusion.network.transfer import Carrying, Ends
from fusion.types import Floats

EAST_M = 111_132.0 * np.cos(np.radians(49.0))


def ends(start_m: float, end_m: float, north_m: float = 0.0) -> Ends:
    """Of a segment that runs east, m from a place."""
    return 8.0 + start_m / EAST_M, 49.0, 8.0 + end_m / EAST_M, 49.0 + north_m / 111_132.0


def knots(length_m: float) -> int:
    return int(interval_count(length_m)) + 1


def curve(length_m: float, at: float, grade: float) -> Floats:
    """Unknowns of a straight road with this height at from_node."""
    out = np.full(2 * knots(length_m), grade)
    out[::2] = at + grade * np.linspace(0, length_m, knots(length_m))
    return out


def measured(length_m: float, seed: int = 0) -> PassFactor:
    """Heights and grades everywhere along a segment, and a word on every nuisance."""
    rng = np.random.default_rng(seed)
    places = np.linspace(0, length_m, 3 * knots(length_m))
    road = np.vstack([height_rows(places, length_m) / 0.5, grade_rows(places, length_m) / 0.01])
    rows = np.hstack([road, rng.normal(size=(len(road), NUISANCES))])
    truth = np.concatenate([curve(length_m, 120.0, 0.05), np.zeros(NUISANCES)])
    value = rows @ truth
    return PassFactor(
        7, 3, 1, rows.T @ rows, rows.T @ value, float(value @ value), len(rows), (0.1, 0.001), 0.0, length_m,
        3e-5, 5, 1.0, 9.0, place=2, lag_s=0.5,
    )  # fmt: skip


lengths = st.floats(3.0, 420.0)
shifts = st.floats(-2.0, 2.0)


@given(length=lengths, start=shifts, end=shifts, back=st.booleans())
def test_a_straight_road_says_what_it_said_wherever_its_ends_are_put(
    length: float, start: float, end: float, back: bool
) -> None:
    """The information is about the same road: at its truth the factor is as well content as before."""
    new = length - start + end
    if new < 1.0 or not 0.8 <= length / new <= 1.25:
        return
    now = ends(length + end, start) if back else ends(start, length + end)
    how = Carrying.between(ends(0.0, length), length, now, new, back=back)
    assert how.back is back
    carried = how.factor(measured(length), 11)
    assert carried.segment == 11
    assert (carried.start_m, carried.end_m) == (0.0, how.new_m)
    at_start = 120.0 + 0.05 * (length + end if back else start)
    truth = np.concatenate([curve(how.new_m, at_start, -0.05 if back else 0.05), np.zeros(NUISANCES)])
    misfit = carried.square - 2 * carried.vector @ truth + truth @ carried.information @ truth
    assert abs(misfit) <= 1e-7 * carried.square
    assert np.array_equal(carried.used, measured(length).used)
    assert np.linalg.eigvalsh(carried.information)[0] > -1e-9 * np.abs(carried.information).max()


@given(length=st.floats(1.0, 60.0), north=st.floats(-2.0, 2.0), end=shifts)
def test_a_slope_stays_what_it_was_however_short_and_crooked(length: float, north: float, end: float) -> None:
    """Also where one segment does not lie along the other: grades are what was measured, not lengths."""
    if (new := float(np.hypot(length + end, north))) < 0.05:
        return
    how = Carrying.between(ends(0, length), length, ends(0, length + end, north), new)
    carried = how.factor(measured(how.old_m), 7)
    # Where there are more knots than before, smoothness says what is between.
    information = carried.information[:-NUISANCES, :-NUISANCES] + smoothness(how.new_m, 3e-5)
    best = np.linalg.solve(information, carried.vector[:-NUISANCES])
    assert slope_row(0.0, how.new_m, how.new_m) @ best == pytest.approx(0.05, abs=0.002)


@given(length=lengths)
def test_turned_round_twice_it_is_as_before(length: float) -> None:
    there = Carrying.between(ends(0, length), length, ends(length, 0), length, back=True)
    once = there.factor(measured(length), 7)
    again = Carrying.between(ends(length, 0), length, ends(0, length), length, back=True).factor(once, 7)
    before = measured(length)
    assert np.allclose(
        again.information, before.information, rtol=1e-9, atol=1e-9 * np.abs(before.information).max()
    )
    assert np.allclose(again.vector, before.vector, rtol=1e-9, atol=1e-9 * np.abs(before.vector).max())


def test_a_part_that_was_driven_is_driven_still() -> None:
    half = PassFactor(**{**{s: getattr(measured(100.0), s) for s in PassFactor.__slots__}, "end_m": 50.0})
    there = Carrying.between(ends(0, 100), 100.0, ends(100, 0), 100.0, back=True).factor(half, 7)
    assert (there.start_m, there.end_m) == pytest.approx((50.0, 100.0))
    longer = Carrying.between(ends(0, 100), 100.0, ends(-1, 100), 101.0).factor(half, 7)
    assert (longer.start_m, longer.end_m) == pytest.approx((0.0, 51.0))


@given(length=lengths, shift=shifts)
def test_passes_can_be_summed_before_or_after(length: float, shift: float) -> None:
    """What a drive's own errors leave of a pass is the same, so sums may be made anew at any time."""
    new = length + shift
    if new < 1.0 or not 0.8 <= length / new <= 1.25:
        return
    how = Carrying.between(ends(0, length), length, ends(0, new), new)
    one = measured(length)
    whole = ConstantsInformation.of_passes([one, measured(length, 1)])
    carried = CondensedPasses.of_drive([how.factor(one, 7)], [1.0], whole, 40, how.new_m)
    assert np.linalg.eigvalsh(carried.information)[0] > -1e-6 * np.abs(carried.information).max()
    assert carried.covered.sum() == 16
