"""Logs with bad epochs: how many, where, and how bad."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accuracy.dirt import (
    KINDS,
    STEP_M,
    GrossErrors,
    Receiver,
    gross_of,
    read_gross_errors,
    spoilt,
)
from accuracy.logs import Columns, write_columns
from fusion.frames import LocalProjection
from fusion.types import Bools

N = 600
GROSS = GrossErrors(np.array([-6.0, 8.0]), np.array([5.0, -9.0]), np.array([30.0, 40.0, 50.0]))
RECEIVER = Receiver(horizontal_mps=0.05, vertical_mps=0.1)
GNSS = ("lat_deg", "lon_deg", "alt_msl_m", "vel_n_mps", "vel_e_mps", "vel_d_mps")
SENSORS = ("acc_x_mps2", "acc_y_mps2", "acc_z_mps2", "pitch_deg", "roll_deg", "yaw_deg", "odo_speed_mps")


@pytest.fixture
def clean() -> Columns:
    """No two epochs are alike in any column."""
    time_s = 1e9 + np.arange(float(N))
    return {"time_s": time_s} | {name: k + np.arange(float(N)) for k, name in enumerate((*GNSS, *SENSORS))}


def spoil(clean: Columns, *names: str, seed: int = 1) -> Columns:
    return spoilt(clean, {name: KINDS[name] for name in names}, 0.1, seed, RECEIVER, GROSS)


def bad(clean: Columns, dirty: Columns, *names: str) -> Bools:
    """Epochs at which one of the columns has changed."""
    return np.any([clean[name] != dirty[name] for name in names], axis=0)


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("Doppler", ("vel_n_mps", "vel_e_mps", "vel_d_mps")),
        ("altitude multipath", ("alt_msl_m",)),
        ("altitude steps", ("alt_msl_m",)),
        ("late positions", GNSS),
        ("late sensors", SENSORS),
        ("knocks", SENSORS[:4]),
    ],
)
def test_a_tenth_of_the_epochs_is_bad_in_the_columns_of_the_kind(
    clean: Columns, name: str, columns: tuple[str, ...]
) -> None:
    dirty = spoil(clean, name)
    for column in columns:
        assert np.count_nonzero(bad(clean, dirty, column)) == N // 10
    assert not bad(clean, dirty, *(column for column in clean if column not in columns)).any()
    again, other = spoil(clean, name), spoil(clean, name, seed=2)
    assert not bad(dirty, again, *clean).any()
    assert bad(dirty, other, *columns).any()


def test_velocities_err_by_gross_errors_times_the_receivers_sigma(clean: Columns) -> None:
    dirty = spoil(clean, "Doppler")
    level, down = (dirty[name] - clean[name] for name in ("vel_n_mps", "vel_d_mps"))
    assert set(np.round(level[level != 0], 6)) == {-0.3, 0.4}
    assert set(np.round(down[down != 0], 6)) == {0.5, -0.9}


def test_altitudes_err_by_metres_and_steps_last(clean: Columns) -> None:
    off = (spoil(clean, "altitude multipath")["alt_msl_m"] - clean["alt_msl_m"]).round(6)
    assert set(off[off != 0]) == {30.0, 40.0, 50.0}
    step = (spoil(clean, "altitude steps")["alt_msl_m"] - clean["alt_msl_m"]).round(6)
    assert set(np.abs(step)) == {0.0, STEP_M}
    assert np.count_nonzero(np.diff(step)) <= 4  # in one piece, or two where the first meets the log's end


def test_late_is_late_by_a_second_or_repeated(clean: Columns) -> None:
    dirty = spoil(clean, "late positions")
    late = clean["lat_deg"] - dirty["lat_deg"]
    assert late.min() == 0.0
    assert 1.0 in late  # late by one epoch
    assert late.max() > 1.0  # repeated: later and later
    sensors = spoil(clean, "late sensors")
    assert set(clean["pitch_deg"] - sensors["pitch_deg"]) <= {-1.0, 0.0, 1.0}


def test_all_kinds_together_share_the_tenth(clean: Columns) -> None:
    dirty = spoil(clean, *KINDS)
    share = np.mean(bad(clean, dirty, *clean))
    assert 0.07 < share <= 0.1
    assert np.count_nonzero(bad(clean, dirty, "vel_d_mps")) <= 2 * N // 10 // len(KINDS)


def test_without_a_real_receivers_errors_its_kinds_are_refused(clean: Columns) -> None:
    with pytest.raises(ValueError, match="real receiver"):
        spoilt(clean, {"Doppler": KINDS["Doppler"]}, 0.1, 1, RECEIVER, None)


def test_gross_errors_are_beyond_four_robust_sigmas() -> None:
    errors = np.append(np.random.default_rng(1).normal(3.0, 0.5, 4000), [13.0, np.nan, -7.0])
    gross, sigma = gross_of(errors)
    assert sigma == pytest.approx(0.5, rel=0.05)
    assert gross[-2:] == pytest.approx([10.0, -10.0], abs=0.1)
    assert len(gross) < 6


def test_gross_errors_of_a_log_beside_its_track(tmp_path: Path) -> None:
    """A drive to the north-east that climbs; week seconds of the track begin at 1000."""
    rng = np.random.default_rng(3)
    ticks = np.arange(0.0, 300.0, 0.2)
    plane = LocalProjection(137.0, 35.0)
    lon, lat = plane.to_lonlat(8 * ticks, 6 * ticks)
    track = {"t_s": 1000 + ticks, "lat_deg": lat, "lon_deg": lon, "alt_m": 40 + 0.2 * ticks}
    write_columns(track, tmp_path / "ref.csv")
    time_s = np.arange(0.0, 299.0)
    log = {
        "time_s": 1_720_915_182 + 1000 + time_s,  # the begin of GPS week 2323 in Unix time
        "vel_n_mps": 6 + 0.02 * rng.normal(size=299),
        "vel_e_mps": 8 + 0.02 * rng.normal(size=299),
        "vel_d_mps": -0.2 + 0.04 * rng.normal(size=299),
        "height_ell_m": 40 + 0.2 * time_s + rng.normal(size=299),
    }
    log["vel_d_mps"][50] += 2.0
    log["height_ell_m"][100:103] += 60.0
    write_columns(log, tmp_path / "log.csv")
    gross = read_gross_errors(tmp_path)
    assert len(gross.horizontal) < 4
    assert np.max(gross.vertical) == pytest.approx(50.0, rel=0.2)
    assert gross.altitude_m[gross.altitude_m > 30] == pytest.approx([60.0] * 3, abs=5)
