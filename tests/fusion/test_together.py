"""Several logs solved together without a database; what goes through ``run_drive`` is tested with each method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from factor_support import Sensors, steady, street
from fusion.lags import LAG_SETTLED_S
from fusion.network.pass_factor import PassFactor
from fusion.roads.table import RoadTable
from fusion.together import solve_network
from street_support import ride

TABLE = street(60.0, 60.0, 60.0, 40.0, 60.0)


def log_of(table: RoadTable, begin_s: float, said: Mapping[int, Sequence[float]]) -> Any:
    """A log that passed rows with these slopes, %, in this order."""
    passes: list[PassFactor] = []
    for row, slopes in said.items():
        passes += [
            steady(table, row, slope, 0.003, sequence=len(passes) + k) for k, slope in enumerate(slopes)
        ]
    track = SimpleNamespace(time_s=np.array([begin_s]))
    report = {"format": "csv"}
    result = SimpleNamespace(factors=tuple(passes), slopes=(), track=track, report=report, late_by=None)
    return SimpleNamespace(rows=np.arange(len(table)), result=result, epoch_s=track.time_s)


def test_a_log_that_contradicts_the_others_is_counted() -> None:
    """Rejected are segments on which no pass of a log is accepted; logs without factors have none."""
    logs = [
        log_of(TABLE, 40.0, {0: [9.0], 1: [9.0, 2.0], 2: [2.0]}),  # wrong; wrong once of twice; right
        log_of(TABLE, 10.0, {}),
        log_of(TABLE, 30.0, {0: [2.0], 1: [2.0], 2: [2.0]}),
        log_of(TABLE, 20.0, {0: [2.1], 1: [2.1], 2: [2.1]}),
    ]
    solved = solve_network(TABLE, None, logs)
    assert solved.rejected == [1, 0, 0, 0]
    assert [solved.parts[row][0].drives for row in range(3)] == [2, 3, 3]
    assert solve_network(TABLE, None, logs[1:2])[:2] == ({}, [0])


def test_the_order_in_which_logs_are_named_changes_no_digit() -> None:
    logs = [log_of(TABLE, 10.0 * k, {row: [2.0 + 0.1 * k] for row in range(k + 1)}) for k in range(4)]
    usual, turned = solve_network(TABLE, None, logs), solve_network(TABLE, None, logs[::-1])
    assert usual.parts == turned.parts
    assert usual.rejected == turned.rejected[::-1]


def test_a_gap_has_a_slope_and_no_drive() -> None:
    solved = solve_network(TABLE, None, [log_of(TABLE, 0.0, {0: [3.0], 1: [3.0], 2: [3.0], 4: [3.0]})])
    (gap,), (beside,) = solved.parts[3], solved.parts[2]
    assert (gap.drives, gap.observations) == (0, 0)
    assert gap.slope_percent == pytest.approx(3.0, abs=1.0)
    assert gap.slope_sigma_percent > beside.slope_sigma_percent


def late_log(table: RoadTable, seed: int, lag_s: float) -> tuple[Any, list[float]]:
    """A log whose heights are so late, taken for 1.5 s late at first; and the lags that it is asked to be made with."""
    late = Sensors(np.nan, altitude_m=0.2, walk_m2_per_s=(0.01, 0.01), lag_s=lag_s)
    passes = ride(table, late, seed)
    asked: list[float] = []

    def late_by(taken_s: float) -> tuple[PassFactor, ...]:
        asked.append(taken_s)
        return tuple(replace(p, lag_s=taken_s) for p in passes)

    log = log_of(table, 100.0 * seed, {})
    log.result.factors = tuple(replace(p, lag_s=1.5) for p in passes)
    log.result.late_by = late_by
    return log, asked


def test_factors_are_made_anew_until_the_lag_stands() -> None:
    """Each altimeter's own, by what precise drives know of the road; one that was taken for right stays near it."""
    table = street(*[60.0] * 20)
    precise = log_of(table, 0.0, {})
    precise.result.factors = tuple(ride(table, Sensors(0.005), 0))
    late, early, right = (late_log(table, seed, lag_s) for seed, lag_s in ((1, 4.5), (2, 0.0), (3, 1.5)))
    solve_network(table, None, [late[0], early[0], right[0], precise])
    assert len(late[1]) > 1, "from far away it takes more than one step"
    assert late[1][-1] == pytest.approx(4.5, abs=2 * LAG_SETTLED_S)
    assert early[1][-1] == pytest.approx(0.0, abs=2 * LAG_SETTLED_S)
    assert all(abs(taken_s - 1.5) < 2 * LAG_SETTLED_S for taken_s in right[1])


def rough_log(seed: int, error: float, sensor: str = "doppler") -> Any:
    """A log over every row whose errors are so many times what it states, by itself and to the network."""
    offset = 0.5 * error * np.random.default_rng(seed).normal(size=len(TABLE))
    log = log_of(TABLE, 1000.0 * seed, {row: [2.0 + offset[row]] for row in range(len(TABLE))})
    log.result.slopes = tuple(
        SimpleNamespace(
            segment=row, slope_percent=2.0 + offset[row], slope_sigma_percent=0.5, passes=1, first_time_s=0.0
        )
        for row in range(len(TABLE))
    )
    log.result.report = {"sensors": {sensor: {}}, "format": "gpx", "altimeter": False}
    return log


def test_sigmas_that_repeats_contradict_count_wider() -> None:
    """Of ten logs or more; and only those of the class that is contradicted."""
    rough, honest = [rough_log(k, 3.0) for k in range(16)], [rough_log(k, 0.8) for k in range(16)]
    wide, usual = solve_network(TABLE, None, rough), solve_network(TABLE, None, rough[:9])
    assert solve_network(TABLE, None, honest).remarks == usual.remarks == []
    (remark,) = wide.remarks
    assert remark.startswith("16 logs of one class (doppler, gpx) are farther apart than they state")
    times = float(remark.split()[-2])
    assert 2.0 < times < 4.0

    alone = replace_factors(rough, times)
    sigma, wanted = (
        [s.parts[row][0].slope_sigma_percent for row in range(len(TABLE))]
        for s in (wide, solve_network(TABLE, None, alone))
    )
    assert sigma == pytest.approx(wanted, rel=0.01)

    mixed = solve_network(TABLE, None, [*rough, *(rough_log(100 + k, 0.8, "pitch") for k in range(16))])
    (remark,) = mixed.remarks
    assert "(doppler, gpx)" in remark


def replace_factors(logs: Sequence[Any], times: float) -> list[Any]:
    """The logs as if they had stated so much larger sigmas to the network, and say nothing by themselves."""
    return [
        SimpleNamespace(
            rows=log.rows,
            epoch_s=log.epoch_s,
            result=SimpleNamespace(
                factors=tuple(f.widened(times) for f in log.result.factors),
                slopes=(),
                track=log.result.track,
                report=log.result.report,
                late_by=None,
            ),
        )
        for log in logs
    ]
