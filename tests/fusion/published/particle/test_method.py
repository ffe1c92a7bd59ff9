"""The particle method on drives: the promises that it makes."""

from __future__ import annotations

from collections.abc import Callable

import numba
import numpy as np
import pytest

from fusion.errors import BadOptionsError
from fusion.pipeline import parse_options, run_drive
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.types import DriveLog

MakeLog = Callable[..., DriveLog]


@pytest.mark.slow
def test_the_result_does_not_depend_on_the_number_of_threads(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = make_log(1, duration_s=60)
    before = numba.get_num_threads()
    results = []
    try:
        for threads in {1, before}:
            numba.set_num_threads(threads)
            results.append(
                run_drive(log, town.roads, town_dem, method="particle", options={"particles": 40_000})[1]
            )
    finally:
        numba.set_num_threads(before)
    first, last = results[0], results[-1]
    assert first.slopes == last.slopes
    assert np.array_equal(first.track.alt_m, last.track.alt_m)


@pytest.mark.slow
def test_another_seed_changes_the_result_within_its_sigma(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = make_log(1, duration_s=240)
    one, two = (
        run_drive(log, town.roads, town_dem, method="particle", options={"particles": 20_000, "seed": seed})[
            1
        ].slopes
        for seed in (1, 2)
    )
    assert one != two
    by_segment = {s.segment: s for s in two}
    apart = [
        (s.slope_percent - by_segment[s.segment].slope_percent) / s.slope_sigma_percent
        for s in one
        if s.segment in by_segment
    ]
    assert np.sqrt(np.mean(np.square(apart))) < 0.7


def test_a_mount_that_is_misaligned_is_levelled_and_reported(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = make_log(3, duration_s=300)
    options = {"particles": 5000}
    _, plain = run_drive(log, town.roads, town_dem, method="particle", options=options)
    _, off = run_drive(
        log, town.roads, town_dem, method="particle", options={**options, "level_pitch": False}
    )
    assert plain.report["mount_pitch_sigma_deg"] < 0.5
    assert off.report["mount_pitch_deg"] is None
    assert plain.slopes != off.slopes


@pytest.mark.slow
def test_slopes_of_the_simulated_town_beat_both_baselines(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    """Pooled over drives of two receiver classes; the margin is wide, the benchmark holds the figures."""
    errors: dict[str, list[float]] = {"particle": [], "raw": [], "dem": []}
    inside: list[bool] = []
    for seed, receiver in ((1, "m8"), (2, "m8"), (3, "phone")):
        log = make_log(seed, duration_s=300, receiver=receiver)
        for method, found in errors.items():
            options = {"particles": 10_000} if method == "particle" else None
            network, result = run_drive(log, town.roads, town_dem, method=method, options=options)
            truth = dict(zip(map(tuple, _keys(town.roads)), town.true_slope_percent, strict=True))
            keys = _keys(network.table)
            if method == "particle":
                inside += [
                    abs(s.slope_percent - truth[tuple(keys[s.segment])]) <= 1.96 * s.slope_sigma_percent
                    for s in result.slopes
                ]
            found += [s.slope_percent - truth[tuple(keys[s.segment])] for s in result.slopes]
    assert np.mean(inside) > 0.85
    rms = {method: float(np.sqrt(np.mean(np.square(e)))) for method, e in errors.items()}
    assert rms["particle"] < rms["raw"]
    assert rms["particle"] < rms["dem"]


def _keys(table: object) -> list[list[int]]:
    columns = (table.osm_way_id, table.from_node, table.to_node)  # type: ignore[attr-defined]
    return np.column_stack(columns).tolist()


@pytest.mark.parametrize(
    "options",
    [{"particles": 10}, {"particles": "many"}, {"trigger_threshold": 0}, {"discretisation": "euler"}],
)
def test_options_out_of_range_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(BadOptionsError, match=next(iter(options))):
        parse_options("particle", options)
