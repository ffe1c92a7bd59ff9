"""Everything that can be chosen for the particle method by name, looped over the registries."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio

from fusion.errors import BadOptionsError
from fusion.filters.resampling import RESAMPLERS
from fusion.filters.triggers import TRIGGERS
from fusion.methods.base import DriveResult
from fusion.options import option_facts
from fusion.pipeline import parse_options, run_drive
from fusion.published.particle.options import ParticleOptions
from fusion.simulate.scene.town import Town
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.terrain.windows import WINDOWS
from fusion.types import DriveLog

MakeLog = Callable[..., DriveLog]
CHOICES = [
    *({"resampling": name} for name in RESAMPLERS),
    *({"resampling_trigger": name} for name in TRIGGERS if name != "never"),
    *({"dem_window": name} for name in WINDOWS),
    {"variant": "ch2"},
    {"discretisation": "exact"},
    {"proposal": "transition", "particles": 20_000},
]


def run(log: DriveLog, town: Town, dem: Dem, **options: object) -> tuple[float, DriveResult]:
    """RMSE of the slopes in percent, and the result."""
    options = {"particles": 4000, **options}
    network, result = run_drive(log, town.roads, dem, method="particle", options=options)
    roads = town.roads
    identities = zip(roads.osm_way_id, roads.from_node, roads.to_node, strict=True)
    true = dict(zip(identities, town.true_slope_percent, strict=True))
    t = network.table
    keys = [(t.osm_way_id[s.segment], t.from_node[s.segment], t.to_node[s.segment]) for s in result.slopes]
    errors = [s.slope_percent - true[key] for s, key in zip(result.slopes, keys, strict=True)]
    return float(np.sqrt(np.mean(np.square(errors)))), result


@pytest.mark.slow
@pytest.mark.parametrize("choice", CHOICES, ids=lambda c: "-".join(map(str, c.values())))
def test_a_choice_measures_slopes(
    choice: dict[str, object], make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    rmse, result = run(make_log(1, duration_s=240), town, town_dem, **choice)
    assert len(result.slopes) > 20
    assert rmse < 3.0  # the terrain alone errs by 4 to 5 % on these roads
    assert 0 < result.report["resampled_share"] <= 1
    assert 0 < result.report["mean_n_eff"] <= result.report["particles"]


def test_without_resampling_the_weights_degenerate_and_nothing_breaks(
    make_log: MakeLog, town: Town, town_dem: Dem
) -> None:
    """SIS, which the thesis's chapter 1 warns of: after a while one particle has all the weight."""
    _, result = run(make_log(1, duration_s=240), town, town_dem, resampling_trigger="never")
    assert result.report["resampled_share"] == 0
    assert result.report["mean_n_eff"] < 0.01 * 4000
    assert all(math.isfinite(s.slope_percent) and s.slope_sigma_percent > 0 for s in result.slopes)
    assert np.isfinite(result.track.alt_m).all()


def test_a_lower_threshold_resamples_less(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(1, duration_s=120)
    for trigger, eager, lazy in (("n_eff", 0.9, 0.1), ("entropy", 0.05, 1.5)):
        shares = [
            run(log, town, town_dem, resampling_trigger=trigger, trigger_threshold=threshold)[1].report[
                "resampled_share"
            ]
            for threshold in (eager, lazy)
        ]
        assert shares[0] > shares[1]


def test_chapter_2_does_not_look_at_the_pitch(make_log: MakeLog, town: Town, town_dem: Dem) -> None:
    log = make_log(1, duration_s=120)
    _, result = run(log, town, town_dem, variant="ch2")
    assert "mount_pitch_deg" not in result.report
    assert run(log, town, town_dem, variant="ch3")[1].slopes != result.slopes
    # Its window is the triangles; asking for them changes nothing.
    assert run(log, town, town_dem, variant="ch2", dem_window="tin")[1].slopes == result.slopes


@pytest.mark.parametrize("option", ["resampling", "resampling_trigger", "dem_window"])
def test_an_unknown_name_is_refused_with_the_known_ones(option: str) -> None:
    registry = {"resampling": RESAMPLERS, "resampling_trigger": TRIGGERS, "dem_window": WINDOWS}[option]
    with pytest.raises(BadOptionsError) as refusal:
        parse_options("particle", {option: "nonsense"})
    assert all(name in str(refusal.value) for name in registry)
    assert option_facts(ParticleOptions)[option].allowed == ", ".join(registry)


def test_posts_of_poor_quality_are_left_out_and_a_missing_layer_is_said(
    make_log: MakeLog, town: Town, town_dem: Dem, tmp_path: Path
) -> None:
    log, dem_file = make_log(1, duration_s=120), tmp_path / "X_dem.tif"
    write_dem(town, dem_file)
    scenes = np.random.default_rng(4).integers(1, 9, size=rasterio.open(dem_file).read(1).shape)
    with rasterio.open(dem_file, "r+") as raster:
        heights = raster.read(1)
        raster.write(np.where(scenes < 3, heights + 60.0, heights).astype(heights.dtype), 1)
        profile = {**raster.profile, "dtype": "uint8", "nodata": None}
    with rasterio.open(tmp_path / "X_num.tif", "w", **profile) as raster:
        raster.write(scenes.astype(np.uint8), 1)
    with Dem.open([dem_file]) as dem:
        shares = [
            run(log, town, dem, dem_window="tin", dem_sigma_m=2.0, dem_min_quality=least)[1].report[
                "dem_used_share"
            ]
            for least in (0, 3)
        ]
    assert shares[1] < 0.8 * shares[0]
    _, unknown = run(log, town, town_dem, dem_min_quality=3)
    assert any("no quality layer" in sentence for sentence in unknown.report["warnings"])
