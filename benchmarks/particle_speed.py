#!/usr/bin/env python3
"""Time of the particle filter per epoch, beside a vectorised numpy loop of the same filter in the same run.

    python benchmarks/particle_speed.py [--particles 1000 10000 100000 1000000] [--rounds 3] [--duration 549]
                                        [--profile N] [--json FILE]

A simulated drive of the length of the thesis's (549 s at 1 Hz) with all five corrections: GNSS, acceleration, pitch,
map, terrain. Both filters take the same epochs, roads and terrain, the same importance density and the same matcher;
the numpy loop (``published/particle/numpy_cloud.py``) does the arithmetic by whole arrays in double precision. Above
100,000 particles the drive is cut short in proportion, to no less than a minute. Rounds alternate between the two;
figures are medians. Memory is the peak resident size of the process above what it held before the filter, in a fresh
process per size.

Columns: particles; threads; ms per epoch of ours and of numpy's; their ratio; ns per particle beyond what an epoch
takes with hardly any particles, which is the same in every row if time grows linearly (times threads: two share the
work of large clouds); our peak memory.

``--profile N`` prints instead, for N particles, where an epoch's time goes: its parts, the loops over a block in the
cache one by one, and what the memory's speed would allow.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numba

from accuracy.arguments import parser_of
from accuracy.scoring import write_json
from fusion.formats import read_log
from fusion.published.nine_state.protocol import EpochFilter
from fusion.published.nine_state.run import DriveRun
from fusion.published.particle.filter import ParticleCloud
from fusion.published.particle.method import prepare, threads_for
from fusion.published.particle.options import ParticleOptions
from fusion.roads.network import RoadNetwork
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.terrain.dem import Dem
from fusion.types import DriveLog, no_progress
from published.particle import profile as particle_profile
from published.particle.numpy_cloud import NumpyCloud

Scene = tuple[DriveLog, RoadNetwork, Dem]
FEWEST = 100
WHOLE_DRIVE = 100_000
SHORTEST_S = 60.0


def make_scene(duration_s: float) -> Scene:
    """One drive through the simulated town with what lies around it."""
    town = make_town(seed=1)
    folder = Path(tempfile.mkdtemp(prefix="particle-speed-"))
    write_dem(town, folder / "dem.tif")
    write_csv(simulate_drive(town, 5, duration_s=duration_s), folder / "drive.csv")
    log = read_log(folder / "drive.csv")
    network = RoadNetwork.project(town.roads)
    return log, network, Dem.open([folder / "dem.tif"])


def seconds_per_epoch(cloud: Callable[[ParticleOptions], EpochFilter], particles: int, scene: Scene) -> float:
    """Run the method's own loop over the scene with the given cloud."""
    options = ParticleOptions(particles=particles)
    run = prepare(*scene, options)[0]
    if not isinstance(run, DriveRun):
        raise TypeError("the particle filter is to go epoch by epoch")
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


def duration_for(particles: int, whole_s: float) -> float:
    """How much of the drive a cloud of this size goes through."""
    return min(whole_s, max(SHORTEST_S, whole_s * WHOLE_DRIVE / particles))


def compare(sizes: list[int], rounds: int, whole_s: float) -> list[dict[str, float]]:
    """One row a size, printed as it comes."""
    scene = make_scene(whole_s)
    seconds_per_epoch(ParticleCloud, FEWEST, scene)  # compiles, or loads what was compiled
    fixed = 1000 * statistics.median(seconds_per_epoch(ParticleCloud, FEWEST, scene) for _ in range(rounds))
    print(f"{len(scene[0].fix)} epochs, medians of {rounds} rounds; {fixed:.3f} ms with {FEWEST} particles")
    print(
        f"{'particles':>10} {'threads':>7} {'ms/epoch':>9} {'numpy ms':>9} {'ratio':>6} {'ns/particle':>11} {'MiB':>6}"
    )
    rows = []
    for particles in sizes:
        duration_s = duration_for(particles, whole_s)
        scene = make_scene(duration_s)
        with threads_for(particles):
            threads = numba.get_num_threads()
        times = [
            [seconds_per_epoch(cloud, particles, scene) for cloud in (ParticleCloud, NumpyCloud)]
            for _ in range(rounds)
        ]
        ours, theirs = (1000 * statistics.median(column) for column in zip(*times, strict=True))
        each_ns = 1e6 * (ours - fixed) / (particles - FEWEST)
        mib = memory_of(particles, duration_s)
        rows.append(
            {
                "particles": particles,
                "threads": threads,
                "ms": ours,
                "numpy_ms": theirs,
                "ratio": theirs / ours,
                "ns_per_particle": each_ns,
                "mib": mib,
            }
        )
        print(
            f"{particles:10d} {threads:7d} {ours:9.3f} {theirs:9.3f} {theirs / ours:6.1f} {each_ns:11.1f} {mib:6.1f}"
        )
    return rows


def profile(particles: int, rounds: int, whole_s: float) -> dict[str, object]:
    """Print and return where the time of an epoch goes."""
    scene = make_scene(duration_for(particles, whole_s))
    seconds_per_epoch(ParticleCloud, FEWEST, scene)
    runs = [profiled_run(particles, scene) for _ in range(rounds)]
    total, parts = min(runs, key=lambda run: run[0])
    print(f"{particles} particles, {total:.3f} ms per epoch, best of {rounds} rounds")
    parts["the rest: sensors, match, terrain's height, track"] = total - sum(parts.values())
    for name, ms in parts.items():
        print(f"  {ms:8.3f} ms {ms / total:5.0%}  {name}")
    loops = particle_profile.loops(particles)
    print(f"one core, a block in the cache: {sum(loops.values()):.1f} ns per particle")
    for name, ns in loops.items():
        print(f"  {ns:8.2f} ns {ns / sum(loops.values()):5.0%}  {name}")
    speed, moved = particle_profile.memory_gb_per_s(), particle_profile.bytes_per_particle()
    print(
        f"memory: one core copies {speed:.0f} GB/s; {moved} bytes per particle and epoch would take "
        f"{1e-6 * moved * particles / speed:.3f} ms"
    )
    return {"particles": particles, "ms": total, "parts_ms": parts, "loops_ns": loops, "gb_per_s": speed}


def profiled_run(particles: int, scene: Scene) -> tuple[float, dict[str, float]]:
    """Milliseconds per epoch, whole and by part."""
    seconds: dict[str, float] = {}
    options = ParticleOptions(particles=particles)
    cloud = ParticleCloud(options)
    with particle_profile.timed_parts(seconds, cloud):
        full_s = seconds_per_epoch(lambda _: cloud, particles, scene)
    epochs = len(scene[0].fix)
    return 1000 * full_s, {name: 1000 * spent / epochs for name, spent in seconds.items()}


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--particles", type=int, nargs="+", default=[1000, 10_000, 100_000, 1_000_000])
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--duration", type=float, default=549.0, help="length of the drive, s")
    parser.add_argument("--profile", type=int, metavar="N", help="where the time goes with N particles")
    parser.add_argument("--memory-of", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.memory_of:
        scene = make_scene(args.duration)
        seconds_per_epoch(ParticleCloud, FEWEST, scene)
        before = resident_mib("VmRSS")
        Path("/proc/self/clear_refs").write_text("5")  # resets the peak
        seconds_per_epoch(ParticleCloud, args.memory_of, scene)
        print(resident_mib("VmHWM") - before)
        return
    if args.profile:
        result: object = profile(args.profile, args.rounds, args.duration)
    else:
        result = compare(args.particles, args.rounds, args.duration)
    write_json(args.json, result)


if __name__ == "__main__":
    main()
