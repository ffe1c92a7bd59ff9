"""Heights above the ellipsoid: doubted where they pass for altitudes above the sea, and turned by a geoid."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from factor_support import street
from fusion.catalogue import METHODS
from fusion.pipeline import run_drive
from fusion.terrain.datum import ELLIPSOID, datum_of_log
from fusion.terrain.geoid import geoid_at, separation_m, taken_above_ellipsoid
from fusion.terrain.height_doubt import height_doubt
from fusion.types import DriveLog, Floats
from geoid_support import APART_M, installed_grid
from profile_support import hills, street_log

TABLE = street(*[60.0] * 20)
TIME_S = 1.7e9 + np.arange(110.0)


@pytest.fixture
def grid(tmp_path: Path) -> Iterator[None]:
    with installed_grid(tmp_path):
        yield


def drive_log() -> DriveLog:
    return street_log(TIME_S, 5 + 10 * (TIME_S - TIME_S[0]), hills, np.random.default_rng(0))


def log_with(change: Callable[[Floats], Floats], **columns: Floats) -> DriveLog:
    log = drive_log()
    return replace(log, fix=replace(log.fix, alt_msl_m=change(log.fix.alt_msl_m), **columns))


def test_a_grid_is_found_where_proj_looks(grid: None) -> None:
    geoid = geoid_at([8.4, 9.0, 8.4], [49.0, 50.0, -30.0])
    assert geoid is not None
    assert geoid.name == "EGM96"
    np.testing.assert_allclose(geoid.height_m, [APART_M, APART_M, np.nan])
    assert geoid_at(8.4, -30.0) is None, "beyond the grid"


def test_altitudes_are_turned_by_the_grid(grid: None) -> None:
    log = log_with(lambda altitude: altitude + APART_M)
    turned = taken_above_ellipsoid(log)
    assert np.allclose(turned.fix.alt_msl_m, drive_log().fix.alt_msl_m)
    assert np.allclose(turned.fix.height_ell_m, log.fix.alt_msl_m)
    assert turned.geoid == "EGM96"


def test_without_a_grid_by_what_the_log_says_or_not_at_all() -> None:
    level = drive_log().fix.alt_msl_m
    stated = log_with(lambda altitude: altitude + 48.0, height_ell_m=level + 96.0)
    assert separation_m(stated) == pytest.approx(48.0)
    assert np.allclose(taken_above_ellipsoid(stated).fix.alt_msl_m, level)
    silent = log_with(lambda altitude: altitude + 48.0, height_ell_m=level + 48.0)
    assert separation_m(silent) is None, "a receiver without a geoid writes 0"
    turned = taken_above_ellipsoid(silent)
    assert datum_of_log(turned) == ELLIPSOID
    assert not turned.fix.has("alt_msl_m")


def test_what_is_off_the_ground_by_the_geoid_fits_it(grid: None) -> None:
    row = np.arange(len(drive_log().fix))
    ground = drive_log().fix.alt_msl_m
    doubt = height_doubt(log_with(lambda altitude: altitude + APART_M + 3), row, ground)
    assert doubt is not None
    assert doubt["above_model_m"] == pytest.approx(APART_M + 3)
    assert (doubt["geoid"], doubt["geoid_m"], doubt["fits"]) == ("EGM96", pytest.approx(APART_M), True)
    other = height_doubt(log_with(lambda altitude: altitude - 80), row, ground)
    assert other is not None
    assert other["fits"] is False, "an altimeter that nobody set"
    assert height_doubt(log_with(lambda altitude: altitude + 15), row, ground) is None
    feet = height_doubt(log_with(lambda altitude: (altitude + 100) / 0.3048 - 100), row, ground)
    assert feet is None or feet["above_model_m"] is None or not feet["fits"]


def test_below_the_sea_is_doubtful_where_no_ground_is_known() -> None:
    below = log_with(lambda altitude: altitude - np.median(altitude) - 31)
    doubt = height_doubt(below, None, None)
    assert doubt == {
        "above_model_m": None,
        "above_sea_m": pytest.approx(-31),
        "geoid": None,
        "geoid_m": None,
        "fits": None,
    }
    row = np.arange(len(below.fix))
    assert height_doubt(below, row, np.full(len(row), np.nan)) == doubt
    assert height_doubt(below, row, below.fix.alt_msl_m) is None, "the ground there is below the sea"
    assert height_doubt(drive_log(), None, None) is None


def test_a_drive_is_computed_with_heights_above_the_ellipsoid(grid: None) -> None:
    plain = run_drive(drive_log(), TABLE, None)[1]
    above = log_with(lambda altitude: altitude + APART_M)
    turned = run_drive(above, TABLE, None, options={"heights": "ellipsoid"})[1]
    assert turned.report["geoid"] == "EGM96"
    assert turned.report["options"]["heights"] == "ellipsoid"
    assert "heights" not in plain.report["options"]
    heights = [np.nanmedian(one.track.alt_m) for one in (plain, turned)]
    assert heights[0] == pytest.approx(heights[1], abs=0.5)
    assert all("heights" in method.options_model.model_fields for method in METHODS.values())
