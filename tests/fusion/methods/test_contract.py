"""What every registered method owes its callers, looped over the registry."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable

import numpy as np
import pytest

from fusion.catalogue import METHODS
from fusion.errors import BadOptionsError, EmptyLogError, MissingSensorError, NoMatchError
from fusion.methods.base import DriveResult
from fusion.pipeline import parse_options, run_drive
from fusion.registry import DEFAULT_METHOD, METHOD_NAMES
from fusion.simulate.scene.town import Town
from fusion.terrain.dem import Dem
from fusion.types import CUES, DriveLog

MakeLog = Callable[..., DriveLog]
QUICK = {"particle": {"particles": 2000}}
MET_BY_POSITIONS = ("positions", "altitudes", "a DEM", "to bridge outages")
"""How the needs begin that a log of positions and elevations meets beside a DEM, and those that only help."""


def run(name: str, log: DriveLog, town: Town, dem: Dem | None) -> DriveResult:
    return run_drive(log, town.roads, dem, method=name, options=QUICK.get(name))[1]


@pytest.fixture(params=list(METHODS))
def method(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_the_default_is_registered_and_names_agree() -> None:
    assert DEFAULT_METHOD in METHODS
    assert all(method.name == name for name, method in METHODS.items())


def test_a_method_describes_itself_and_its_options(method: str) -> None:
    thing = METHODS[method]
    assert thing.source
    assert thing.description.endswith(".")
    assert thing.needs
    assert set(thing.cues) <= set(CUES)
    for name, field in thing.options_model.model_fields.items():
        assert field.description, f"{method}.{name} has no description"
        assert not field.is_required()


def test_slopes_are_finite_with_positive_sigmas_and_distinct_segments(
    method: str, make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = make_log(1, duration_s=240)
    network, result = run_drive(log, town.roads, town_dem, method=method, options=QUICK.get(method))
    assert len(result.slopes) > 5
    segments = [s.segment for s in result.slopes]
    assert segments == sorted(set(segments))
    driven = set(np.unique(result.track.segment).tolist())
    for slope in result.slopes:
        assert 0 <= slope.segment < len(network)
        assert slope.segment in driven
        assert math.isfinite(slope.slope_percent)
        assert 0 < slope.slope_sigma_percent < math.inf
        assert slope.observations >= 1
        assert slope.passes >= 1
        assert log.fix.time_s[0] - 1 <= slope.first_time_s <= slope.last_time_s <= log.fix.time_s[-1] + 1


def test_the_report_is_json_and_says_what_was_done(
    method: str, make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    report = run(method, make_log(1, duration_s=240), town, town_dem).report
    again = json.loads(json.dumps(report, allow_nan=False))
    assert again["method"] == method
    assert again["options"] == parse_options(method, QUICK.get(method)).model_dump(mode="json")
    assert 0.5 < again["matched_share"] <= 1
    assert again["segments_estimated"] > 5
    assert again["epochs"] > 200
    assert again["distance_m"] > 500
    assert again["median_slope_sigma_percent"] > 0
    assert again["dem_share"] > 0.8
    assert again["dem_only"] == (not METHODS[method].cues)
    assert [warning for warning in again["warnings"] if "elevation model" in warning] == []


@pytest.mark.slow
def test_the_same_input_gives_the_same_numbers(
    method: str, make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    log = make_log(1, duration_s=240)
    assert run(method, log, town, town_dem).slopes == run(method, log, town, town_dem).slopes


@pytest.mark.slow
def test_an_outage_is_survived(method: str, make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(2, duration_s=300, outages=[(100.0, 40.0)])
    assert len(run(method, log, town, town_dem).slopes) > 5


def test_positions_and_elevations_alone_are_enough(
    method: str, make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    """But for a method that declares a need beyond them: that one must refuse, in the words of its declaration."""
    full = make_log(1, duration_s=240)
    bare = DriveLog(source_format="gpx", fix=full.fix)
    unmet = [need for need in METHODS[method].needs if not need.startswith(MET_BY_POSITIONS)]
    if not unmet:
        assert len(run(method, bare, town, town_dem).slopes) > 5
        return
    with pytest.raises(MissingSensorError) as refusal:
        run(method, bare, town, town_dem)
    assert f"Method {method!r} needs {unmet[0]}" in str(refusal.value)


def test_without_any_height_a_method_says_what_is_missing(method: str, make_log: MakeLog, town: Town) -> None:
    fix = make_log(1, duration_s=240).fix
    flat = dataclasses.replace(
        fix, alt_msl_m=np.full(len(fix), np.nan), height_ell_m=np.full(len(fix), np.nan)
    )
    with pytest.raises(MissingSensorError, match=r"(altitude|DEM)"):
        run(method, DriveLog(source_format="gpx", fix=flat), town, None)


def test_three_epochs_are_too_few(method: str, make_log: MakeLog, town: Town) -> None:
    log = DriveLog(source_format="gpx", fix=make_log(1, duration_s=240).fix.take(slice(0, 3)))
    with pytest.raises(EmptyLogError, match=r"3 position\(s\); at least 4"):
        run(method, log, town, None)


def test_a_log_far_from_every_road_says_where_it_lies(method: str, make_log: MakeLog, town: Town) -> None:
    fix = make_log(1, duration_s=240).fix
    away = DriveLog(source_format="gpx", fix=dataclasses.replace(fix, lat_deg=fix.lat_deg - 20))
    with pytest.raises(NoMatchError, match="comes near a known road"):
        run(method, away, town, None)


def test_an_unknown_option_is_refused_with_the_known_ones(method: str) -> None:
    with pytest.raises(BadOptionsError, match="'nonsense'") as refusal:
        parse_options(method, {"nonsense": 1})
    assert refusal.value.where == "nonsense"
    for name in METHODS[method].options_model.model_fields:
        assert name in str(refusal.value)


def test_names_are_known_without_loading_what_they_name() -> None:
    assert tuple(METHODS) == METHOD_NAMES
