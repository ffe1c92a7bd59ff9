#!/usr/bin/env python3
"""Time of the particle filter per epoch, beside a vectorised numpy loop of the same filter in the same run.

    python benchmarks/particle_speed.py [--particles 1000 10000 100000] [--rounds 3] [--duration 549] [--json FILE]

A simulated drive of the length of the thesis's (549 s at 1 Hz) with all five corrections: GNSS, acceleration, pitch,
map, terrain. Both filters take the same epochs, roads and terrain, the same importance density and the same matcher;
the numpy loop (``NumpyCloud`` below) does the arithmetic by whole arrays, with ``numpy.random.Generator`` and
multinomial resampling. Rounds alternate between the two; the figures are medians. Memory is the peak resident size of
the process above what it held before the filter, in a fresh process per particle count.

Columns: particles; ms per epoch of ours and of numpy's; their ratio; our peak memory.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from fusion.formats import read_log
from fusion.methods import kinematics as k
from fusion.methods.epoch_filter import Estimate, Measurement, PredictedMap
from fusion.methods.particle import prepare, threads_for
from fusion.methods.particle_filter import ParticleCloud
from fusion.methods.particle_options import ParticleOptions
from fusion.roads.network import RoadNetwork
from fusion.simulate import make_town
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, no_progress

Scene = tuple[DriveLog, RoadNetwork, Dem]


class NumpyCloud(ParticleCloud):
    """The same filter by whole-array numpy: what one writes first, done with care."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._rng = np.random.default_rng(self.options.seed)

    def restart(self, mean: np.ndarray, sigma: np.ndarray) -> None:
        self._cloud = mean[:, None] + sigma[:, None] * self._rng.standard_normal(self._cloud.shape)
        self._logw = np.zeros(self.options.particles)
        self._ref[:] = mean[k.X], mean[k.Y], math.atan2(mean[k.VY], mean[k.VX]), mean[k.Z]

    def sense(self, dt_s: float | None, measured: Measurement) -> PredictedMap:
        if dt_s is not None:
            self._move(dt_s, measured)
        c = self._cloud
        self._pitch = np.arctan(c[k.VZ] / np.hypot(c[k.VX], c[k.VY]))
        self._logw -= 0.5 * (measured.pitch_rad - self._pitch) ** 2 * measured.inv_var_pitch
        heading = np.arctan2(c[k.VY], c[k.VX]) - self._ref[2]
        self._turn = (heading + np.pi) % (2 * np.pi) - np.pi
        w = np.exp(self._logw - self._logw.max())
        w /= w.sum()
        z = np.stack([c[k.X] - self._ref[0], c[k.Y] - self._ref[1], self._turn])
        mean = z @ w
        covariance = (z * w) @ z.T - np.outer(mean, mean)
        x, y, heading = self._ref[:3] + mean
        return PredictedMap(x, y, math.remainder(heading, 2 * math.pi), covariance)

    def _move(self, dt: float, measured: Measurement) -> None:
        c, q = self._cloud, self._q_per_s * dt
        half = 0.5 * dt * dt if self.options.discretisation == "exact" else 0.0
        for axis in range(3):
            a, v, u = 3 * axis, 3 * axis + 1, 3 * axis + 2
            for row, mean, var in (
                (u, c[u] + c[v] * dt + c[a] * half, q[axis, 2]),
                (v, c[v] + c[a] * dt, q[axis, 1]),
                (a, c[a], q[axis, 0]),
            ):
                inv = measured.inv_var[row]
                gain = var * inv / (1 + var * inv)
                miss = measured.z[row] - mean
                self._logw -= 0.5 * miss**2 * (inv / (1 + var * inv))
                noise = self._rng.standard_normal(len(mean))
                c[row] = mean + gain * miss + math.sqrt(var * (1 - gain)) * noise

    def locate(
        self,
        road: tuple[float, float, float] | None,
        use_heading: bool,
        ground_m: float | None,
        inv_var_ground: float,
    ) -> Estimate:
        o, c = self.options, self._cloud
        if road is not None:
            off = (c[k.X] - road[0]) ** 2 + (c[k.Y] - road[1]) ** 2
            self._logw -= 0.5 * off / o.map_sigma_m**2
            if use_heading:
                turn = self._turn - road[2] + self._ref[2]
                turn = (turn + np.pi) % (2 * np.pi) - np.pi
                self._logw -= 0.5 * turn**2 / o.map_sigma_rad**2
        if ground_m is not None:
            miss = ground_m - (c[k.Z] - o.antenna_height_m / np.cos(self._pitch))
            self._logw -= 0.5 * miss**2 * inv_var_ground
        w = np.exp(self._logw - self._logw.max())
        w /= w.sum()
        state = c @ w
        pitch = float(self._pitch @ w)
        spread = (c - state[:, None]) ** 2 @ w
        heading = self._ref[2] + math.atan2(np.sin(self._turn) @ w, np.cos(self._turn) @ w)
        n_eff = float(1 / np.sum(w**2))
        resampled = n_eff < (o.trigger_threshold or 2 / 3) * o.particles
        if resampled:
            # Side "right" of the cumulative weights inverts them; the last may round below 1.
            ancestors = np.searchsorted(np.cumsum(w), np.sort(self._rng.random(o.particles)), side="right")
            self._cloud = c[:, np.minimum(ancestors, o.particles - 1)]
            self._logw = np.zeros(o.particles)
        return Estimate(
            state=state,
            heading_rad=math.remainder(heading, 2 * math.pi),
            pitch_rad=pitch,
            pitch_sigma_rad=math.sqrt(float((self._pitch - pitch) ** 2 @ w)),
            h_sigma_m=math.sqrt(spread[k.X] + spread[k.Y]),
            z_sigma_m=math.sqrt(spread[k.Z]),
            n_eff=n_eff,
            resampled=resampled,
        )


def make_scene(duration_s: float) -> Scene:
    """One drive through the simulated town with what lies around it."""
    town = make_town(seed=1)
    folder = Path(tempfile.mkdtemp(prefix="particle-speed-"))
    town.write_dem(folder / "dem.tif")
    town.drive(5, duration_s=duration_s).write_csv(folder / "drive.csv")
    log = read_log(folder / "drive.csv")
    network = RoadNetwork.project(town.roads)
    return log, network, Dem.open([folder / "dem.tif"])


def seconds_per_epoch(cloud: type[ParticleCloud], particles: int, scene: Scene) -> float:
    """Run the method's own loop over the scene with the given cloud."""
    options = ParticleOptions(particles=particles)
    run, _ = prepare(*scene, options)
    run.engine = cloud(options)
    begin = time.perf_counter()
    with threads_for(particles):
        run.run(no_progress)
    return (time.perf_counter() - begin) / len(run.epochs)


def resident_mib(field: str) -> float:
    """``VmRSS`` (now) or ``VmHWM`` (peak since the last reset) of this process, MiB; Linux."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith(field))


def memory_of(particles: int, duration_s: float) -> float:
    """MiB that the filter adds, measured in a process of its own."""
    command = [sys.executable, __file__, "--memory-of", str(particles), "--duration", str(duration_s)]
    return float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--particles", type=int, nargs="+", default=[1000, 10_000, 100_000])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=549.0, help="length of the drive, s")
    parser.add_argument("--memory-of", type=int, help=argparse.SUPPRESS)
    parser.add_argument("--json", type=Path)
    args = parser.parse_args()
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line sets it
    scene = make_scene(args.duration)
    seconds_per_epoch(ParticleCloud, 1000, scene)  # compiles, or loads what was compiled
    if args.memory_of:
        before = resident_mib("VmRSS")
        Path("/proc/self/clear_refs").write_text("5")  # resets the peak
        seconds_per_epoch(ParticleCloud, args.memory_of, scene)
        print(resident_mib("VmHWM") - before)
        return
    print(f"{len(scene[0].fix)} epochs, medians of {args.rounds} rounds")
    print(f"{'particles':>10} {'ms/epoch':>9} {'numpy ms':>9} {'ratio':>6} {'MiB':>6}")
    rows = []
    for particles in args.particles:
        rounds = [
            [seconds_per_epoch(cloud, particles, scene) for cloud in (ParticleCloud, NumpyCloud)]
            for _ in range(args.rounds)
        ]
        ours, theirs = (1000 * statistics.median(column) for column in zip(*rounds, strict=True))
        memory = memory_of(particles, args.duration)
        rows.append(
            {"particles": particles, "ms": ours, "numpy_ms": theirs, "ratio": theirs / ours, "mib": memory}
        )
        print(f"{particles:10d} {ours:9.3f} {theirs:9.3f} {theirs / ours:6.1f} {memory:6.1f}")
    if args.json:
        args.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
