"""What drives say: errors that go on from pass to pass, jumps that are let go, passes that are not accepted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

import street_support
from factor_support import Sensors, steady, street
from fusion.network.adjust import adjust
from fusion.network.drive_beliefs import (
    LAG_MEAN_S,
    PASS_FREEDOM,
    REJECT_SIGMAS,
    DriveBeliefs,
)
from fusion.network.equations import EquationSystem
from fusion.network.pass_columns import PassColumns, in_order
from fusion.network.pass_factor import ENTRY, EXIT, NUISANCES, PassFactor
from fusion.network.road_beliefs import RoadBeliefs
from fusion.roads.table import RoadTable
from street_support import EVERYTHING, true_percent

COUNT = 24
STREET = street(*[50.0] * COUNT)
TRUE_PERCENT = true_percent(STREET)
GRADES = Sensors(0.02)
LEVEL = Sensors(np.nan, pressure_m=0.05, walk_m2_per_s=(0.1, 0.002))


def ride(sensors: Sensors, seed: int = 1, rows: Sequence[int] | None = None) -> list[PassFactor]:
    return street_support.ride(STREET, sensors, seed, rows)


def learned(
    drives: Mapping[int, list[PassFactor]], table: RoadTable = STREET, rounds: int = 4
) -> DriveBeliefs:
    """What is believed of drives after some rounds."""
    passes = PassColumns.of(drives)
    road = RoadBeliefs(table, passes)
    said = DriveBeliefs(passes, road.unknowns, in_order(drives)[1])
    system = EquationSystem(said.size, [*road.blocks(), *said.blocks()], np.array([], np.int64))
    for number in range(rounds):
        solution = system.solve()
        road.learn(solution)
        said.learn(solution, number == 0)
    return said


def lifted(passes: Sequence[PassFactor], sensor: int, metres: float) -> list[PassFactor]:
    """The passes with the errors of a height sensor greater by so much: what they say shifts with them."""
    out = []
    for one in passes:
        shift = np.zeros(len(one.vector))
        own = len(shift) - NUISANCES
        shift[[own + ENTRY.start + sensor, own + EXIT.start + sensor]] = metres
        moved = one.information @ shift
        square = one.square + 2 * one.vector @ shift + shift @ moved
        out.append(replace(one, vector=one.vector + moved, square=float(square)))
    return out


def test_errors_walk_for_as_long_as_lies_between_two_passes_and_a_second() -> None:
    passes = ride(EVERYTHING, rows=(0, 1, 2))
    late = replace(
        passes[2], first_time_s=passes[2].first_time_s + 59, last_time_s=passes[2].last_time_s + 59
    )
    said = learned({0: [*passes[:2], late]}, rounds=0)
    variance = 1 / said.walks.information[:, 0, 0]
    rates = passes[0].walk_m2_per_s
    assert variance == pytest.approx([rates[0], 60 * rates[0], rates[1], 60 * rates[1]])
    assert said.walks.variables.shape == (4, 2)
    of_pass = said.unknowns[0].of_pass
    assert said.walks.variables[1].tolist() == [of_pass[1, EXIT.start], of_pass[2, ENTRY.start]]


def test_passes_that_overlap_in_time_are_a_second_apart() -> None:
    """Clocks and matching are not so exact that the next pass never begins before the last one ends."""
    passes = ride(EVERYTHING, rows=(0, 1))
    early = replace(passes[1], first_time_s=passes[0].last_time_s - 5)
    said = learned({0: [passes[0], early]}, rounds=0)
    assert 1 / said.walks.information[:, 0, 0] == pytest.approx(passes[0].walk_m2_per_s)


def test_drives_have_nothing_in_common_but_the_mean_of_lags() -> None:
    said = learned({3: ride(EVERYTHING), 7: ride(EVERYTHING, 2)}, rounds=0)
    own = [set(said.unknowns[d].of_pass.ravel().tolist()) - {-1} for d in (3, 7)]
    assert not own[0] & own[1]
    assert said.lag_mean is None
    late = Sensors(0.02, altitude_m=0.3, lag_s=2.0)
    both = learned({3: ride(late), 7: ride(late, 2)}, rounds=0)
    assert both.lag_mean == both.size - 1


def test_a_jump_between_two_passes_is_let_go_where_it_happens() -> None:
    passes, others = ride(LEVEL), {k: ride(LEVEL, k) for k in (2, 3)}
    jumped = [*passes[:12], *lifted(passes[12:], 1, 20.0)]
    found, clean = (adjust(STREET, {0: p, **others}) for p in (jumped, passes))
    moved = np.abs(found.slope_percent - clean.slope_percent)
    assert moved.max() < 0.05
    assert all(found.accepted.values())
    weight = learned({0: jumped, **others}).walks.weight
    assert int(np.argmin(weight)) == 11
    assert weight[11] < 0.01 * np.median(weight)


def test_a_jump_of_a_drive_that_nobody_confirms_spoils_no_slope() -> None:
    """Whether the sensor jumped or the map joins what does not meet, one drive cannot tell."""
    passes = ride(LEVEL)
    jumped = [*passes[:12], *lifted(passes[12:], 1, 20.0)]
    found, clean = (adjust(STREET, {0: p}) for p in (jumped, passes))
    assert np.abs(found.slope_percent - clean.slope_percent)[np.r_[0:11, 13:COUNT]].max() < 0.3
    assert np.all(np.abs(found.slope_percent - TRUE_PERCENT)[11:13] < 3 * found.slope_sigma_percent[11:13])


def test_a_drive_whose_heights_step_more_than_it_says_is_trusted_less() -> None:
    rng = np.random.default_rng(4)
    honest = [ride(LEVEL, seed) for seed in range(3)]
    level = np.cumsum(0.5 * rng.normal(size=COUNT))
    stepping = [
        one
        for p, metres in zip(ride(LEVEL, 9), level.tolist(), strict=True)
        for one in lifted([p], 1, metres)
    ]
    said = learned(dict(enumerate([*honest, stepping])), rounds=6)
    # Behind the one of nobody stand the series of each drive's altitude and barometer.
    scale = said.walk_scale[2:9:2]
    assert np.all(scale[:3] < 2)
    assert scale[3] > 10


def weight_at(misfit: float, scale: float) -> float:
    """Student's t at first, and beyond the limit besides as if it were out of the question."""
    scaled = misfit / scale
    return (PASS_FREEDOM + 1) / (PASS_FREEDOM + scaled) * min(1.0, REJECT_SIGMAS**2 / scaled) / scale


def test_the_weight_of_a_pass_falls_with_its_misfit() -> None:
    """As it is in units of what its drive's passes usually miss by."""
    table = street(60.0)

    def weights(offset_percent: float) -> tuple[float, float, DriveBeliefs]:
        crowd = {k: [steady(table, 0, 2.0, 0.01)] for k in range(50)}
        said = learned({**crowd, 99: [steady(table, 0, 2.0 + offset_percent, 0.01)]}, table)
        (group,) = said.groups
        return float(group.blocks.weight[0]), float(group.blocks.weight[-1]), said

    for offset in (0.0, 1.0, 2.0, 3.5, 2 * REJECT_SIGMAS):
        fair, odd, said = weights(offset)
        assert said.pass_scale[:-1].tolist() == [1.0] * 50
        assert fair == pytest.approx((PASS_FREEDOM + 1) / PASS_FREEDOM, rel=0.02)
        assert odd == pytest.approx(weight_at(max(offset**2, 1e-9), said.pass_scale[-1]), rel=0.1)
        assert odd < 1.2 * weight_at(max(offset**2, 1e-9), 1.0) or offset > 3.5


def overconfident(passes: Sequence[PassFactor], times: float) -> list[PassFactor]:
    """The passes as if all of their errors were so many times smaller than they are."""
    by = times**2
    return [
        replace(p, information=by * p.information, vector=by * p.vector, square=by * p.square) for p in passes
    ]


def test_a_drive_that_states_ten_times_too_good_is_weighed_down() -> None:
    """Beside nine others it is found out, and weighs about what it would if it were honest."""
    honest = {seed: ride(GRADES, seed) for seed in range(9)}
    boasting = {**honest, 9: overconfident(ride(GRADES, 9), 10.0)}
    said = learned(boasting, rounds=6)
    assert np.all(said.pass_scale[:9] < 1.5)
    assert 30 < said.pass_scale[9] < 150
    found, fair = (adjust(STREET, d) for d in (boasting, {**honest, 9: ride(GRADES, 9)}))
    assert np.median(found.slope_sigma_percent / fair.slope_sigma_percent) == pytest.approx(1.0, abs=0.15)


def test_a_drive_alone_is_taken_at_its_word() -> None:
    said = learned({0: ride(GRADES, 3)})
    assert said.pass_scale.tolist() == [pytest.approx(1.0, abs=0.1)]
    assert np.all(said.pass_scale >= 1.0), "nobody is better than he says"


def test_the_misfit_of_honest_passes_is_about_one() -> None:
    drives = {seed: ride(EVERYTHING, seed) for seed in range(6)}
    result = adjust(STREET, drives)
    passes = PassColumns.of(drives)
    said = DriveBeliefs(passes, RoadBeliefs(STREET, passes).unknowns, in_order(drives)[1])
    misfit = np.concatenate(said.misfits(result.solution))
    assert np.mean(misfit) == pytest.approx(1.0, abs=0.15)
    assert all(result.accepted.values())


@pytest.mark.parametrize("lag_s", [0.0, 3.0])
def test_an_altimeter_s_lag_is_found_where_the_road_is_known(lag_s: float) -> None:
    """By another drive's Doppler; the hill is the same, only later."""
    late = Sensors(np.nan, altitude_m=0.2, walk_m2_per_s=(0.01, 0.01), lag_s=lag_s)
    precise = {10 + k: ride(Sensors(0.01), k) for k in range(3)}
    found = adjust(STREET, {0: ride(late, 5), **precise})
    assert found.lag_s.keys() == {0}
    assert found.lag_s[0] == pytest.approx(lag_s, abs=0.5)
    assert min(lag_s, LAG_MEAN_S[0]) - 0.1 < found.lag_mean_s < max(lag_s, LAG_MEAN_S[0]) + 0.1


def test_lags_of_drives_that_agree_pull_their_mean() -> None:
    late = Sensors(np.nan, altitude_m=0.2, walk_m2_per_s=(0.01, 0.01), lag_s=3.5)
    precise = {30 + k: ride(Sensors(0.01), k) for k in range(3)}
    few, many = (
        adjust(STREET, {**{k: ride(late, k) for k in range(count)}, **precise}).lag_mean_s for count in (1, 8)
    )
    assert LAG_MEAN_S[0] < few < many < 3.5 + 0.3


def test_what_drives_are_called_and_the_order_of_their_passes_change_nothing() -> None:
    drives = {5: ride(EVERYTHING, 5), 2: ride(EVERYTHING, 2)}
    one = adjust(STREET, drives)
    other = adjust(STREET, {2: drives[2][::-1], 5: drives[5][::-1]})
    assert np.array_equal(one.slope_percent, other.slope_percent)
    assert one.accepted == other.accepted
