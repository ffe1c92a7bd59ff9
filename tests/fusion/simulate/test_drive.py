"""A drive: its epochs, outages and passes; one seed makes one."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.errors import UnknownNameError
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.motion.vehicle import Driver
from fusion.simulate.scene.town import Town
from fusion.simulate.write.csv_file import csv_columns


def test_one_way_roads_are_driven_one_way(several: list[SimulatedDrive]) -> None:
    for drive in several:
        oneway = drive.town.roads.oneway[drive.truth.segment]
        assert np.all(drive.truth.forward[oneway == 1])
        assert not np.any(drive.truth.forward[oneway == -1])


def test_gnss_is_lost_in_the_tunnel_and_in_outages(town: Town) -> None:
    drive = simulate_drive(town, 4, 900.0, outages=[(50.0, 20.0), (200.0, 5.0)], first=town.roads.tunnel)
    t = drive.elapsed_s
    cut = ((t >= 50) & (t < 70)) | ((t >= 200) & (t < 205))
    tunnel = town.roads.tunnel[drive.truth.segment]
    assert tunnel.sum() > 5
    np.testing.assert_array_equal(drive.has_gnss, ~(cut | tunnel))


@pytest.mark.parametrize(("rate_hz", "count"), ((1.0, 60), (5.0, 300), (10.0, 600)))
def test_epochs_come_at_the_rate_on_whole_milliseconds(town: Town, rate_hz: float, count: int) -> None:
    drive = simulate_drive(town, 2, 60.0, rate_hz=rate_hz)
    assert len(drive.elapsed_s) in (count - 1, count)
    np.testing.assert_allclose(np.diff(drive.elapsed_s), 1 / rate_hz, atol=1e-9)
    np.testing.assert_allclose(drive.elapsed_s * 1000, np.round(drive.elapsed_s * 1000), atol=1e-6)


def test_passes_follow_the_route(several: list[SimulatedDrive]) -> None:
    for drive in several:
        passes = drive.passes()
        length = drive.town.length_m
        assert [p.segment for p in passes] == list(drive.motion.route.segment[: len(passes)])
        assert all(0 <= p.driven_m <= length[p.segment] + 1e-9 for p in passes)
        whole = [p.driven_m / length[p.segment] for p in passes[1:-1]]
        assert np.median(whole) > 0.9


def test_visits_count_what_was_driven(town: Town) -> None:
    visits = np.zeros(len(town.roads), np.int64)
    drive = simulate_drive(town, 6, 120.0, visits=visits)
    expected = np.bincount([p.segment for p in drive.passes()], minlength=len(visits))
    np.testing.assert_array_equal(visits, expected)


def test_a_seed_makes_one_drive(town: Town) -> None:
    a, b, c = simulate_drive(town, 11, 60.0), simulate_drive(town, 11, 60.0), simulate_drive(town, 12, 60.0)
    for name, column in csv_columns(a).items():
        np.testing.assert_array_equal(column, csv_columns(b)[name])
    assert a.start_time_s != c.start_time_s
    assert not np.array_equal(a.gnss.alt_msl_m[:50], c.gnss.alt_msl_m[:50])


def test_bad_wishes_are_refused(town: Town) -> None:
    with pytest.raises(UnknownNameError, match="There is no receiver called 'x9'"):
        simulate_drive(town, 1, 60.0, receiver="x9")
    with pytest.raises(ValueError, match="positive duration"):
        simulate_drive(town, 1, 0.0)
    with pytest.raises(ValueError, match="positive duration and rate"):
        simulate_drive(town, 1, 60.0, rate_hz=0.0)
    with pytest.raises(ValueError, match=r"a top speed, not 0\.0 m/s"):
        simulate_drive(town, 1, 60.0, driver=Driver(top_speed_mps=0.0))
