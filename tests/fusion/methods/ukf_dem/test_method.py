"""Method ``ukf-dem``: what it looks at, what it refuses, and that it is worth its while."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from fusion.errors import BadOptionsError, MissingSensorError
from fusion.methods.base import DriveResult
from fusion.pipeline import parse_options, run_drive
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.terrain.windows import WINDOWS
from fusion.types import DriveLog

MakeLog = Callable[..., DriveLog]
Errors = dict[tuple[int, int, int], tuple[float, float]]


def run(log: DriveLog, town: Town, dem: Dem | None, **options: object) -> DriveResult:
    return run_drive(log, town.roads, dem, method="ukf-dem", options=options)[1]


def without_heights(log: DriveLog) -> DriveLog:
    unknown = np.full(len(log.fix), np.nan)
    return replace(log, fix=replace(log.fix, alt_msl_m=unknown, height_ell_m=unknown))


def test_without_a_dem_it_says_so(make_log: MakeLog, town: Town) -> None:
    with pytest.raises(MissingSensorError, match="Method 'ukf-dem' needs a DEM"):
        run(make_log(1, duration_s=240), town, None)


def test_only_positions_count(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    """Without an outage the slopes are those of the bare positions, in every digit; with Doppler they are not."""
    log = make_log(1, duration_s=240)
    bare = DriveLog("gpx", log.fix)
    assert run(log, town, town_dem).slopes == run(bare, town, town_dem).slopes
    assert run(log, town, town_dem, doppler=True).slopes != run(bare, town, town_dem).slopes


def test_other_sensors_keep_time_through_an_outage(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(2, duration_s=300, outages=[(100.0, 30.0)])
    track = run(log, town, town_dem).track
    gone = np.flatnonzero(~track.has_gnss)
    assert len(gone) >= 25
    assert track.h_sigma_m[gone[-1]] > 1.2 * track.h_sigma_m[gone[0]]  # the matched road holds it


def test_heights_may_come_from_the_terrain_alone(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(1, duration_s=240)
    flat, full = run(without_heights(log), town, town_dem), run(log, town, town_dem)
    assert len(flat.slopes) > 5
    assert median_sigma(flat) > 1.5 * median_sigma(full)
    ground = town_dem.heights(flat.track.lon_deg, flat.track.lat_deg)
    assert np.nanstd(flat.track.alt_m - ground) < 5.0


def median_sigma(result: DriveResult) -> float:
    return float(np.median([s.slope_sigma_percent for s in result.slopes]))


@pytest.mark.parametrize("window", WINDOWS)
def test_every_window_is_taken(window: str, make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    result = run(make_log(1, duration_s=240), town, town_dem, dem_window=window)
    assert len(result.slopes) > 5
    assert result.report["options"]["dem_window"] == window
    assert 0.5 < result.report["dem_share"] <= 1.0


def test_the_spread_of_the_sigma_points_hardly_matters(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    """Curvature is mild: parameters far apart give nearly the same slopes."""
    log = make_log(1, duration_s=240)
    close, wide = run(log, town, town_dem), run(log, town, town_dem, alpha=1.0, beta=0.0, kappa=-6.0)
    by_segment = {s.segment: s for s in wide.slopes}
    apart = [
        (s.slope_percent - by_segment[s.segment].slope_percent) / s.slope_sigma_percent
        for s in close.slopes
        if s.segment in by_segment
    ]
    assert len(apart) > 5
    assert close.slopes != wide.slopes
    assert np.sqrt(np.mean(np.square(apart))) < 0.3


@pytest.mark.parametrize("options", [{"alpha": 0.0}, {"kappa": -9.0}, {"beta": -1.0}, {"dem_window": "none"}])
def test_options_out_of_range_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(BadOptionsError, match=next(iter(options))):
        parse_options("ukf-dem", options)


@pytest.mark.slow
def test_it_beats_what_it_is_made_of(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    """Pooled over drives of two receivers: better than the altitudes alone and than the terrain alone."""
    errors: dict[str, list[float]] = {"ukf-dem": [], "raw": [], "dem": []}
    inside: list[bool] = []
    truth = dict(zip(keys(town.roads), town.true_slope_percent, strict=True))
    for seed, receiver in ((1, "m8"), (2, "m8"), (3, "phone"), (4, "phone")):
        log = make_log(seed, duration_s=300, receiver=receiver)
        for method in errors:
            network, result = run_drive(log, town.roads, town_dem, method=method)
            own = keys(network.table)
            off = np.array([s.slope_percent - truth[own[s.segment]] for s in result.slopes])
            errors[method] += off.tolist()
            if method == "ukf-dem":
                sigma = np.array([s.slope_sigma_percent for s in result.slopes])
                inside += (np.abs(off) <= 1.96 * sigma).tolist()
    rms = {method: float(np.sqrt(np.mean(np.square(off)))) for method, off in errors.items()}
    assert rms["ukf-dem"] < 0.9 * min(rms["raw"], rms["dem"])
    assert 0.88 < np.mean(inside) <= 1.0


def keys(table: object) -> list[tuple[int, int, int]]:
    columns = (table.osm_way_id, table.from_node, table.to_node)  # type: ignore[attr-defined]
    return [tuple(row) for row in np.column_stack(columns).tolist()]
