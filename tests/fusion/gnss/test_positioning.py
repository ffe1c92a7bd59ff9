"""Positions by name: what is taken of a log, what is published of a solution, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fusion.catalogue import POSITIONINGS, SOLVERS
from fusion.errors import BadOptionsError, EmptyLogError, MissingSensorError, UnknownNameError
from fusion.gnss.positioning import H_FLOOR_M, V_FLOOR_M, positioned
from fusion.published.canyon.drive import CanyonDrive, canyon_of
from fusion.registry import DEFAULT_POSITIONING
from fusion.signals import Navigation
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import make_town
from fusion.types import DriveLog, GnssFix, GnssVelocity

LEAD = ("auto", "receiver")


@pytest.fixture(scope="module")
def canyon() -> CanyonDrive:
    return canyon_of(simulate_drive(make_town(1), 3, 60.0))


@pytest.fixture(scope="module")
def log(canyon: CanyonDrive) -> DriveLog:
    return DriveLog("test", GnssFix.empty(), raw=canyon.raw())


def with_fix(log: DriveLog, h_acc_m: float) -> DriveLog:
    """The log with positions of a receiver's own, a kilometre off."""
    made = positioned(log, "ls").log.fix
    return replace(log, fix=replace(made, lat_deg=made.lat_deg + 0.01, h_acc_m=np.full(len(made), h_acc_m)))


def test_the_choice_begins_with_the_default_and_the_receiver() -> None:
    assert tuple(POSITIONINGS)[:2] == LEAD
    assert LEAD[0] == DEFAULT_POSITIONING
    assert tuple(POSITIONINGS)[2:] == tuple(SOLVERS)
    for name, one in POSITIONINGS.items():
        assert one.name == name
        assert one.description.endswith(".")
        assert one.source


@pytest.mark.parametrize("name", ["ls", "ekf", "one-sided"])
def test_solved_positions_take_the_place_of_the_log_s(name: str, log: DriveLog, canyon: CanyonDrive) -> None:
    found = positioned(log, name)
    fix = found.log.fix
    assert len(fix) == len(canyon.ride.time_s)
    assert np.abs(fix.time_s - canyon.ride.time_s).max() < 0.1
    assert found.name == name
    assert found.report["solved"] == len(fix)
    assert found.report["systems"][0] == "GPS"
    assert np.all(fix.h_acc_m >= H_FLOOR_M)
    assert np.all(fix.v_acc_m >= V_FLOOR_M)
    epochs = found.solved_epochs()
    assert epochs is not None
    assert epochs.covariance.shape == (len(fix), 6, 6)
    assert set(epochs.reflected[0]) <= {f"{s}{n:02d}" for s in "GEC" for n in range(1, 64)}


def test_velocities_are_doppler_s_unless_the_receiver_knows_the_vertical(log: DriveLog) -> None:
    made = positioned(log, "one-sided").log
    assert made.velocity.has("vel_d_mps")
    own = GnssVelocity.assemble(made.fix.time_s, vel_d_mps=np.full(len(made.fix), 0.5))
    kept = positioned(replace(log, velocity=own), "one-sided").log.velocity
    assert np.all(kept.vel_d_mps == 0.5)


def test_without_doppler_nothing_is_known_of_the_vertical_speed(log: DriveLog) -> None:
    assert log.raw is not None
    silent = replace(log.raw.signals, range_rate_mps=np.full_like(log.raw.signals.range_rate_mps, np.nan))
    made = positioned(replace(log, raw=replace(log.raw, signals=silent)), "one-sided").log
    assert made.velocity.has("vel_n_mps", "vel_e_mps")
    assert not made.velocity.has("vel_d_mps")


def test_auto_takes_raw_data_where_there_is_nothing_else(log: DriveLog) -> None:
    assert positioned(log).name == "one-sided"


@pytest.mark.parametrize(
    ("stated_m", "taken"), [(0.5, "receiver"), (60.0, "one-sided"), (np.nan, "one-sided")]
)
def test_auto_goes_by_the_stated_accuracy(stated_m: float, taken: str, log: DriveLog) -> None:
    assert positioned(with_fix(log, stated_m)).name == taken


def test_auto_solves_nothing_where_no_solution_could_be_stated_to_be_better(log: DriveLog) -> None:
    assert log.raw is not None
    good = replace(with_fix(log, H_FLOOR_M), raw=replace(log.raw, navigation=Navigation()))
    assert positioned(good).log is good  # raw data that give nothing would be told of


def test_auto_keeps_a_log_whose_raw_data_give_nothing(log: DriveLog) -> None:
    assert log.raw is not None
    blind = replace(with_fix(log, 9.0), raw=replace(log.raw, navigation=Navigation()))
    found = positioned(blind)
    assert found.name == "receiver"
    assert "could not be used" in found.log.warnings[-1]
    with pytest.raises(EmptyLogError, match=r"navigation"):
        positioned(replace(blind, fix=GnssFix.empty()))


def test_a_log_without_raw_data_is_refused_in_one_sentence(log: DriveLog) -> None:
    bare = replace(with_fix(log, 5.0), raw=None)
    assert positioned(bare).log is bare
    for name in SOLVERS:
        with pytest.raises(MissingSensorError, match=r"needs raw pseudoranges .*this log has none"):
            positioned(bare, name)


def test_a_log_without_positions_is_refused_as_logged(log: DriveLog) -> None:
    with pytest.raises(EmptyLogError, match="one-sided"):
        positioned(log, "receiver")


def test_unknown_names_and_options(log: DriveLog) -> None:
    with pytest.raises(UnknownNameError, match="one-sided"):
        positioned(log, "best")
    with pytest.raises(BadOptionsError, match=r"'tau' .*Its options are: smooth"):
        positioned(log, "one-sided", {"tau": 3})


def test_heights_of_the_road_help_once(log: DriveLog) -> None:
    first = positioned(log, "one-sided", {"doppler": False})
    assert first.with_heights is not None
    second = first.with_heights(first.height_ell_m + 4.0)
    assert second.with_heights is None
    assert 0.05 < np.mean(second.height_ell_m - first.height_ell_m) < 4.0
