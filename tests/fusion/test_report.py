"""How far a drive went."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from fusion.report import track_length_m
from fusion.types import Track

STEP_M = 10.0
N = 11


def northwards(**columns: Any) -> Track:
    """Eleven positions a second and ten metres apart."""
    unknown = {spec.name: np.full(N, np.nan) for spec in fields(Track)}
    flags = {"segment": np.full(N, -1), "has_gnss": np.ones(N, bool), "after_gap": np.zeros(N, bool)}
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
    anew = replace(track, after_gap=np.arange(N) == 5)
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
