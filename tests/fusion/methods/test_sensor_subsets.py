"""Whatever a log lacks, a method stays near the baseline that uses the least: no runaway, no false certainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fusion.catalogue import METHODS
from fusion.pipeline import run_drive
from fusion.registry import DEFAULT_METHOD
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.types import Attitude, DriveLog, GnssVelocity, SpecificForce

MakeLog = Callable[..., DriveLog]

pytestmark = pytest.mark.slow


def only_positions(log: DriveLog) -> DriveLog:
    unknown = np.full(len(log.fix), np.nan)
    return DriveLog("gpx", replace(log.fix, h_acc_m=unknown, v_acc_m=unknown))


def horizontal_velocity(log: DriveLog) -> DriveLog:
    unknown = np.full(len(log.velocity), np.nan)
    return replace(only_positions(log), velocity=replace(log.velocity, vel_d_mps=unknown, s_acc_mps=unknown))


def no_attitude(log: DriveLog) -> DriveLog:
    return replace(log, attitude=Attitude.empty())


def no_velocity(log: DriveLog) -> DriveLog:
    return replace(log, velocity=GnssVelocity.empty())


def no_force(log: DriveLog) -> DriveLog:
    return replace(log, force=SpecificForce.empty())


def everything(log: DriveLog) -> DriveLog:
    return log


SUBSETS = [everything, only_positions, horizontal_velocity, no_attitude, no_velocity, no_force]


def errors(
    log: DriveLog, town: Town, dem: Dem | None, method: str
) -> dict[tuple[int, int, int], tuple[float, float]]:
    """Error and sigma by segment."""
    options = {"particles": 20_000} if method == "particle" else None
    network, result = run_drive(log, town.roads, dem, method=method, options=options)
    truth = dict(zip(identities(town.roads), town.true_slope_percent, strict=True))
    own = identities(network.table)
    return {
        own[s.segment]: (s.slope_percent - truth[own[s.segment]], s.slope_sigma_percent)
        for s in result.slopes
    }


def identities(table: object) -> list[tuple[int, int, int]]:
    columns = (table.osm_way_id, table.from_node, table.to_node)  # type: ignore[attr-defined]
    return [tuple(row) for row in np.column_stack(columns).tolist()]


def runs(method: str, subset: Callable[[DriveLog], DriveLog], with_dem: bool) -> bool:
    """Whether the method does without what is not there; the contract tests hold it to refuse what it needs."""
    needs = METHODS[method].needs
    more = any("beside the positions" in need for need in needs)
    return (with_dem or "a DEM" not in needs) and not (more and subset is only_positions)


def usual(method: str, subset: Callable[[DriveLog], DriveLog], with_dem: bool) -> bool:
    """Whether every run of the tests tries it: the default method all ways, of the others each subset one way."""
    turn = with_dem == (SUBSETS.index(subset) % 2 == 0)
    return method == DEFAULT_METHOD or turn or not runs(method, subset, not with_dem)


LONG = pytest.mark.long("the published methods once more, with and without an elevation model")
CASES = [
    pytest.param(method, subset, with_dem, marks=() if usual(method, subset, with_dem) else LONG)
    for method in METHODS
    if method not in ("raw", "dem")
    for subset in SUBSETS
    for with_dem in (True, False)
    if runs(method, subset, with_dem)
]


@pytest.mark.parametrize(
    ("method", "subset", "with_dem"), CASES, ids=lambda value: getattr(value, "__name__", str(value))
)
def test_no_method_runs_away(
    method: str,
    subset: Callable[[DriveLog], DriveLog],
    with_dem: bool,
    make_log: MakeLog,
    town: Town,
    town_dem: Dem,
) -> None:
    dem = town_dem if with_dem else None
    ours, raws, everything_ours = [], [], []
    for seed, receiver in ((7, "m8"), (8, "phone")):
        log = subset(make_log(seed, duration_s=400, receiver=receiver))
        mine, raw = errors(log, town, dem, method), errors(log, town, dem, "raw")
        assert len(mine) >= len(raw)
        everything_ours += list(mine.values())
        both = [key for key in raw if key in mine]
        ours += [mine[key][0] for key in both]
        raws += [raw[key][0] for key in both]
    error, sigma = np.array(everything_ours).T
    # On the same segments; 25 % are left for what few epochs, and few particles, add by chance.
    assert np.sqrt(np.mean(np.square(ours))) < 1.25 * np.sqrt(np.mean(np.square(raws)))
    assert np.mean(np.abs(error) <= 1.96 * sigma) > 0.8
    assert np.max(np.abs(error)) < 40
