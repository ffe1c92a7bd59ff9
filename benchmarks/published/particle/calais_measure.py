"""Runs on drives of the Calais shape, laid beside the simulation's truth and beside a filter over GNSS alone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np

from fusion.catalogue import METHODS
from fusion.formats import read_log
from fusion.frames import wrap_angle
from fusion.methods.base import DriveResult
from fusion.pipeline import parse_options
from fusion.published import ukf_dem
from fusion.published.nine_state.motion import AX, VX
from fusion.published.particle import method as particle
from fusion.roads.network import RoadNetwork
from fusion.simulate.drive import SimulatedDrive
from fusion.simulate.motion.vehicle import MotionState
from fusion.simulate.receiver.readings import RECEIVERS
from fusion.simulate.write.csv_file import write_csv
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, Floats, Ints, no_progress
from published.particle.scene.calais import Interchange, calais_drive, make_interchange
from published.particle.scene.satellite_dem import write_raster

RASTERS = ("aster", "world30")
AXES = ("E", "N", "U")
_MODULES: Mapping[str, ModuleType] = {"particle": particle, "ukf-dem": ukf_dem}
_MOVING_MPS = 1.0
_NOWHERE = 1e-9
"""A gate that no match passes."""
_CLIMB_SIGMA_MPS = 0.084
"""Climb at the drive's mean speed: Doppler of 0.1 m/s, and a pitch that the springs disturb by 0.009 rad."""

Figures = dict[str, float]


@dataclass(frozen=True)
class Scene:
    """One seed's drive: what was simulated and what the filters get."""

    town: Interchange
    drive: SimulatedDrive
    log: DriveLog
    network: RoadNetwork
    dems: Mapping[str, Dem]

    @classmethod
    def make(cls, seed: int, receiver: str, folder: Path) -> Scene:
        """Simulate a seed and write and read its files, as anybody's would be."""
        town = make_interchange(seed)
        drive = calais_drive(town, seed, receiver=receiver)
        write_csv(drive, folder / "drive.csv")
        dems = {}
        for model in RASTERS:
            write_raster(town, folder / f"{model}_{seed}.tif", model)
            dems[model] = Dem.open([folder / f"{model}_{seed}.tif"])
        log = read_log(folder / "drive.csv")
        return cls(town, drive, log, RoadNetwork.project(town.roads, town.projection), dems)


@dataclass(frozen=True)
class Estimated:
    """What a filter made of a drive; ``state`` is (epochs, 9), the nine states of the thesis."""

    result: DriveResult
    state: Floats
    resampled: float


def estimate(
    scene: Scene, method: str, options: Mapping[str, Any], raster: str | None, log: DriveLog | None = None
) -> Estimated:
    """Run a method as the product does, and keep the filter's states, of which a track holds only a part."""
    module, states = _MODULES[method], []
    prepare = module.prepare

    def keep(*args: Any) -> Any:
        states.append(prepare(*args))
        return states[0]

    with mock.patch.object(module, "prepare", keep):
        result = METHODS[method].estimate(
            log or scene.log,
            scene.network,
            None if raster is None else scene.dems[raster],
            parse_options(method, options),
            no_progress,
        )
    run = states[0][0] if isinstance(states[0], tuple) else states[0]
    share = result.report.get("resampled_share", math.nan)
    return Estimated(result, run.rows.state[run.rows.done], float(share))


def gnss_alone(scene: Scene, velocity: bool) -> Estimated:
    """The thesis's reference: the filter over the GNSS data alone, without map, terrain and inertial sensors.

    Without them the model is linear, and the Kalman filter is what the thesis's 100,000 particles approximate.
    """
    if velocity:
        log = DriveLog(source_format="csv", fix=scene.log.fix, velocity=scene.log.velocity)
    else:
        log = DriveLog(source_format="csv", fix=scene.log.fix)
    options = {"filter": "kf", "variant": "ch2", "period_s": 1.0, "doppler": velocity, "match_gate": _NOWHERE}
    return estimate(scene, "particle", options, None, log)


def against_truth(scene: Scene, estimated: Estimated) -> Figures:
    """Errors of a run, by quantity, units as in the tables."""
    track, truth = estimated.result.track, _truth(scene, estimated)
    out = {
        **_spread("acceleration", estimated.state[:, AX::3] - truth.acceleration_mps2),
        **_spread("velocity", estimated.state[:, VX::3] - truth.velocity_mps),
    }
    x, y = scene.town.projection.to_xy(track.lon_deg, track.lat_deg)
    error = np.column_stack([x - truth.x_m, y - truth.y_m, track.alt_m - truth.z_m])
    out |= _spread("position", error)
    size = np.linalg.norm(error, axis=1)
    out |= {"3-D position error, std": float(size.std()), "3-D position error, max": float(size.max())}
    moving = truth.speed_mps > _MOVING_MPS
    out |= _spread_of("yaw", wrap_angle(track.heading_rad - truth.yaw_rad)[moving])
    out |= _spread_of("pitch", (track.pitch_rad - np.arctan(truth.grade))[moving])
    out["altitude, the filter's own sigma"] = float(np.median(track.alt_sigma_m))
    return (
        out
        | _matches(track.segment, truth)
        | {"epochs resampled": 100 * estimated.resampled}
        | _slopes(scene, estimated)
    )


def beside(estimated: Estimated, reference: Estimated) -> Figures:
    """Differences of a run from the reference over GNSS alone."""
    difference = estimated.state - reference.state
    turns = wrap_angle(estimated.result.track.heading_rad - reference.result.track.heading_rad)
    moving = estimated.result.track.speed_mps > _MOVING_MPS
    pitch = estimated.result.track.pitch_rad - reference.result.track.pitch_rad
    figures = {
        **_spread("acceleration", difference[:, AX::3]),
        **_spread("velocity", difference[:, VX::3]),
        **_spread("position", difference[:, VX + 1 :: 3]),
        **_spread_of("yaw", turns[moving]),
        **_spread_of("pitch", pitch[moving]),
    }
    size = np.linalg.norm(difference[:, VX + 1 :: 3], axis=1)
    figures |= {"3-D position error, std": float(size.std()), "3-D position error, max": float(size.max())}
    return {f"{name}, beside GNSS alone": value for name, value in figures.items()}


def best_altitude_std_m(receiver: str, seed: int) -> float:
    """Spread about its mean of the altitude error of the best causal filter: the median of many drives, metres.

    A Kalman filter over the error of an altitude integrated from climbs, the receiver's bias and its Gauss-Markov
    error, with the variances by which they are drawn.
    """
    epochs, draws = 549, 200
    p, rng = RECEIVERS[receiver], np.random.default_rng([seed, 60])
    decay = math.exp(-1.0 / p.vertical_s)
    move = np.array([1.0, 1.0, decay])
    gained = np.array([_CLIMB_SIGMA_MPS, 0.0, p.vertical_m * math.sqrt(1 - decay**2)])
    start = np.array([0.0, p.vertical_bias_m, p.vertical_m])
    covariance = np.diag([10.0**2, *start[1:] ** 2])  # the first fix says where the altitude begins
    true, mean, errors = start * rng.normal(size=(draws, 3)), np.zeros((draws, 3)), []
    for _ in range(epochs):
        measured = true.sum(axis=1) + p.vertical_white_m * rng.normal(size=draws)
        column = covariance.sum(axis=1)
        gain = column / (column.sum() + p.vertical_white_m**2)
        mean = mean + np.outer(measured - mean.sum(axis=1), gain)
        covariance = covariance - np.outer(gain, column)
        errors.append(mean[:, 0] - true[:, 0])
        true = true * move + gained * rng.normal(size=(draws, 3))
        mean, covariance = mean * move, covariance * np.outer(move, move) + np.diag(gained**2)
    return float(np.median(np.std(errors, axis=0)))


def _truth(scene: Scene, estimated: Estimated) -> MotionState:
    return scene.drive.motion.at(estimated.result.track.time_s - scene.drive.start_time_s)


def _spread(quantity: str, errors: Floats) -> Figures:
    """Standard deviations and means of the columns (E, N, U)."""
    out: Figures = {}
    for axis, column in zip(AXES, errors.T, strict=True):
        out |= _spread_of(f"{quantity} {axis}", column)
    return out


def _spread_of(quantity: str, errors: Floats) -> Figures:
    return {f"{quantity}, std": float(np.std(errors)), f"{quantity}, mean": float(np.mean(errors))}


def _matches(segment: Ints, truth: MotionState) -> Figures:
    matched = segment >= 0
    return {
        "map-match rate": 100 * float(np.mean(matched)),
        "matches on the segment driven": 100 * float(np.mean(segment[matched] == truth.segment[matched])),
    }


def _slopes(scene: Scene, estimated: Estimated) -> Figures:
    """How many driven segments got a slope, and how good the slopes are."""
    driven = {p.segment for p in scene.drive.passes()}
    slopes = [s for s in estimated.result.slopes if s.segment in driven]
    segment = np.array([s.segment for s in slopes], np.int64)
    value = np.array([s.slope_percent for s in slopes])
    sigma = np.array([s.slope_sigma_percent for s in slopes])
    error = value - scene.town.true_slope_percent[segment]
    return {
        "segments with a slope": float(len(slopes)),
        "driven segments with a slope": 100 * len(slopes) / len(driven),
        "most epochs on a segment": float(max(s.observations for s in slopes)),
        "steepest slope down": float(value.min()),
        "steepest slope up": float(value.max()),
        "slope error, RMS": float(np.sqrt(np.mean(error**2))),
        "slope errors within 1.96 sigma": 100 * float(np.mean(np.abs(error) <= 1.96 * sigma)),
    }
