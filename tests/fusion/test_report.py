"""What a report says of any drive: how far it went, what its log lacks, what the elevation model knows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, cast

import numpy as np
import pytest

from factor_support import street
from fusion.errors import MissingSensorError
from fusion.formats import FORMATS
from fusion.pipeline import run_drive
from fusion.report import NO_HEIGHTS, track_length_m, with_contradiction
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Ints, Track
from profile_support import hills, pressure_of, street_log

STEP_M = 10.0
N = 11


def northwards(**columns: Any) -> Track:
    """Eleven positions a second and ten metres apart."""
    unknown = {spec.name: np.full(N, np.nan) for spec in fields(Track)}
    flags = {"segment": np.full(N, -1), "has_gnss": np.ones(N, bool), "after_outage": np.zeros(N, bool)}
    path = {
        "time_s": 1_700_000_000.0 + np.arange(N),
        "lat_deg": 49.0 + STEP_M / 111_200 * np.arange(N),
        "lon_deg": np.full(N, 8.4),
    }
    return Track(**(unknown | flags | path | columns))


def test_a_track_is_as_long_as_its_path() -> None:
    assert track_length_m(northwards()) == pytest.approx(100, rel=1e-3)


def test_nothing_is_counted_across_an_interruption() -> None:
    track = northwards()
    pause = replace(track, time_s=track.time_s + 60 * (np.arange(N) >= 5))
    anew = replace(track, after_outage=np.arange(N) == 5)
    assert track_length_m(pause) == pytest.approx(90, rel=1e-3)
    assert track_length_m(anew) == pytest.approx(90, rel=1e-3)


def test_a_jump_is_no_driving() -> None:
    track = northwards()
    there_and_back = replace(track, lat_deg=track.lat_deg + (np.arange(N) == 5))
    assert track_length_m(there_and_back) == pytest.approx(80, rel=1e-3)


def test_unknown_positions_are_passed_over() -> None:
    track = northwards()
    hidden = replace(track, lat_deg=np.where(np.arange(N) == 5, np.nan, track.lat_deg))
    assert track_length_m(hidden) == pytest.approx(100, rel=1e-3)
    assert track_length_m(northwards(lat_deg=np.full(N, np.nan))) is None


TABLE = street(*[60.0] * 30)
TIME_S = 1.7e9 + np.arange(175.0)
ALONG_M = 5 + 10 * (TIME_S - TIME_S[0])


def drive_log(without: Sequence[str] = (), seed: int = 1) -> DriveLog:
    return street_log(TIME_S, ALONG_M, hills, np.random.default_rng(seed), without=without)


@dataclass
class Raster:
    """An elevation model of the first part of the street, ``off_m`` too high."""

    share: float = 1.0
    off_m: float = 0.0
    description: str = "made"
    datum: str = "EGM96"
    names: tuple[str, ...] = ("N49E008.hgt",)

    def heights(self, lon: Floats, lat: Floats) -> Floats:
        along = (lon - TABLE.lon0_deg[0]) / (TABLE.lon1_deg[-1] - TABLE.lon0_deg[0]) * TABLE.length_m.sum()
        known = along < 5 + self.share * (ALONG_M[-1] - ALONG_M[0])
        return np.where(known if self.share < 1 else along > -100, hills(along) + self.off_m, np.nan)

    def heights_along(self, lon: Floats, lat: Floats, line: Ints) -> Floats:
        return self.heights(lon, lat)


def report(log: DriveLog, raster: Raster | None = None, method: str = "profile") -> dict[str, Any]:
    found: dict[str, Any] = run_drive(log, TABLE, cast(Dem, raster), method=method)[1].report
    return found


def told(log: DriveLog, raster: Raster | None = None) -> list[str]:
    warnings: list[str] = report(log, raster)["warnings"]
    return warnings


def with_altitudes(log: DriveLog, change: Callable[[Floats], Floats]) -> DriveLog:
    return replace(log, fix=replace(log.fix, alt_msl_m=change(log.fix.alt_msl_m)))


def bare(log: DriveLog) -> DriveLog:
    """Places and heights, as a simple device records them."""
    return DriveLog(log.source_format, log.fix)


@pytest.mark.parametrize("name", list(FORMATS))
def test_advice_is_that_for_the_kind_of_device(name: str) -> None:
    log = replace(drive_log(["velocity", "altitude"]), source_format=name)
    *_, altitude, doppler = told(log)
    assert "no altitudes" in altitude
    assert altitude.endswith(FORMATS[name].altitude_advice)
    assert "no vertical Doppler velocity" in doppler
    assert doppler.endswith(FORMATS[name].doppler_advice)
    places = DriveLog(name, drive_log(["altitude"]).fix)
    with pytest.raises(MissingSensorError) as refusal:
        run_drive(places, TABLE, None)
    assert FORMATS[name].altitude_advice in str(refusal.value)


def test_advice_for_several_formats_together_is_general() -> None:
    joined = replace(drive_log(["velocity"]), source_format="ubx + csv")
    *_, doppler = told(joined)
    assert "no vertical Doppler velocity" in doppler
    assert "UBX-NAV-PVT" in doppler


def test_a_barometer_makes_up_for_altitudes_and_doppler() -> None:
    log = drive_log(["velocity", "altitude"])
    assert told(replace(log, pressure=pressure_of(TIME_S, hills(ALONG_M)))) == []


def test_a_method_is_told_only_what_it_could_have_used() -> None:
    assert report(bare(drive_log()), method="raw")["warnings"] == []
    alone = report(DriveLog("gpx", drive_log(["altitude"]).fix), Raster(), method="dem")
    assert alone["dem_only"]
    assert alone["warnings"] == [], "who asks for the elevation model's slopes knows that they are"


def test_slopes_of_the_elevation_model_alone_are_called_so() -> None:
    places = DriveLog("gpx", drive_log(["altitude"]).fix)
    found = report(places, Raster())
    assert found["dem_only"]
    assert "rest on the elevation model alone" in found["warnings"][0]
    for log in (drive_log(), bare(drive_log()), drive_log(["altitude", "velocity"])):
        assert not report(log, Raster())["dem_only"]
    assert not report(drive_log())["dem_only"]


@pytest.mark.parametrize(
    ("share", "said"), [(1.0, None), (0.93, None), (0.6, "under 60 %"), (0.0, "no height")]
)
def test_an_elevation_model_that_ends_on_the_way(share: float, said: str | None) -> None:
    found = report(drive_log(), Raster(share))
    assert found["dem_share"] == pytest.approx(share, abs=0.02)
    warnings = [warning for warning in found["warnings"] if "There is N49E008.hgt. Give one" in warning]
    assert len(warnings) == len(found["warnings"]) == (said is not None)
    assert all(said is not None and said in warning for warning in warnings)
    if not share:
        _, alone = run_drive(drive_log(), TABLE, None)
        assert run_drive(drive_log(), TABLE, cast(Dem, Raster(0.0)))[1].slopes == alone.slopes


def test_rasters_are_named_but_not_all_of_hundreds() -> None:
    (said,) = told(drive_log(), Raster(0.0, names=tuple(f"{k}.tif" for k in range(300))))
    assert "There is 0.tif, 1.tif, 2.tif, 3.tif and 296 more." in said


@pytest.mark.parametrize("off_m", [-90.0, -30.0, -9.0, 0.0, 9.0, 16.0, 30.0, 48.0])
def test_a_constant_offset_is_told_beyond_what_models_and_receivers_err(off_m: float) -> None:
    warnings = told(with_altitudes(drive_log(), lambda altitude: altitude + off_m), Raster())
    if abs(off_m) < 20:
        assert warnings == []
        return
    (said,) = warnings
    found = float(said.split("altitudes are ")[1].split(" m ")[0])
    assert found == pytest.approx(abs(off_m), abs=5)
    assert f"m {'above' if off_m > 0 else 'below'} the elevation model (datum EGM96)" in said
    assert "Slopes are not affected" in said


def test_heights_above_the_ellipsoid_that_say_so_are_no_wrong_datum() -> None:
    fix = drive_log().fix
    unknown = np.full(len(fix), np.nan)
    stated = replace(fix, height_ell_m=fix.alt_msl_m + 48.0, alt_msl_m=unknown)
    assert told(replace(drive_log(), fix=stated), Raster()) == []


def test_feet_are_no_offset() -> None:
    """Their slopes are three times too steep: nobody may read that a constant does no harm."""
    warnings = told(bare(with_altitudes(drive_log(), lambda altitude: altitude / 0.3048)), Raster())
    assert [said for said in warnings if "seem to be in feet" in said]
    assert not [said for said in warnings if "not affected" in said]


def test_altitudes_of_0_are_none() -> None:
    zeros = with_altitudes(drive_log(), np.zeros_like)
    assert NO_HEIGHTS in told(zeros)
    slopes = [run_drive(log, TABLE, None)[1].slopes for log in (zeros, drive_log(["altitude"]))]
    assert slopes[0] == slopes[1]
    assert report(zeros)["height_datum"] is None


def test_altitudes_that_never_change_are_told_and_used() -> None:
    flat = with_altitudes(drive_log(), lambda altitude: np.full_like(altitude, 112.0))
    (said,) = told(flat)
    assert "All altitudes of the log are 112 m" in said
    offset = told(flat, Raster())
    assert not [one for one in offset if "not affected" in one]


def test_a_few_contradictions_are_no_warning_and_an_old_one_goes() -> None:
    many = with_contradiction(["w"], 4, 10)
    assert "on 4 of 10 segments (40%)" in many[1]
    assert with_contradiction(many, 3, 10) == with_contradiction(["w"], 0, 0) == ["w"]
    assert with_contradiction(many, 5, 10)[1:] != many[1:]
