"""Where the particle filter's time goes: parts of an epoch, loops over a block, and the memory's speed.

``particle_speed.py --profile`` prints this. The parts are timed inside a run over the benchmark's drive; the loops one
by one over a single block that stays in the cache, on one core, so that their sum says what arithmetic alone would
take.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from fusion.filters.random import LANE_WORDS, fill_normals, seed_lanes
from fusion.published.nine_state import motion as k
from fusion.published.particle import filter as particle_filter
from fusion.published.particle import layout, locate_pass, sense_pass

# The compiled parts of an epoch by what the filter calls them.
PARTS = {
    "predict_and_weigh": "sensing pass: copies, motion, GNSS, acceleration, pitch",
    "predicted_map": "sums of the sensing pass",
    "weigh_and_estimate": "locating pass: map, terrain, estimate",
    "weights_summary": "sums of the locating pass: weights",
    "state_summary": "sums of the locating pass: state",
    "fill_weights": "weights for resampling",
}


@contextmanager
def timed_parts(seconds: dict[str, float], cloud: particle_filter.ParticleCloud) -> Iterator[None]:
    """Add up in ``seconds`` what each part takes while the context lasts."""
    originals = {name: getattr(particle_filter, name) for name in PARTS}
    resample = cloud._resample

    def timed(name: str, call: Callable[..., object]) -> Callable[..., object]:
        def wrapper(*args: object) -> object:
            begin = time.perf_counter()
            result = call(*args)
            seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - begin
            return result

        return wrapper

    try:
        for name, call in originals.items():
            setattr(particle_filter, name, timed(PARTS[name], call))
        cloud._resample = timed("resampling", resample)  # type: ignore[assignment]
        yield
    finally:
        for name, call in originals.items():
            setattr(particle_filter, name, call)
        cloud._resample = resample


def loops(particles: int) -> dict[str, float]:
    """Nanoseconds per particle of each loop over one block, on one core."""
    n = min(particles, layout.BLOCK)
    blocks = layout.blocks_of(particles)
    source = np.zeros((blocks, layout.CHUNK), np.float32)
    mean = np.array([0.0, 9.0, 0.0, 0.0, -4.0, 0.0, 0.0, 0.3, 0.0])
    sense_pass.draw_cloud(source, 0, 1, mean, np.full(9, 0.5))
    chunk = source[0].copy()
    rng = np.random.default_rng(0)
    weights = rng.exponential(size=particles) ** 2
    ancestors = np.sort(rng.choice(particles, particles, p=weights / weights.sum()))[:n]
    lanes, normals = np.empty(LANE_WORDS, np.uint64), np.empty(3 * layout.BLOCK, np.float32)
    seed_lanes(0, 1, 0, lanes)
    fill_normals(lanes, normals)
    still, top = np.float32(0), np.float32(0)
    draws = sense_pass._importance_density(np.full(9, 0.1), np.zeros(9), np.ones(9), np.zeros(9), True)
    draws[:, 1] = 0.0  # the gain: what is repeated here must not wear the cloud out
    axis, logw, out = chunk[: 3 * layout.ROW], chunk[layout.LOGW * layout.ROW :], np.empty(n)
    row_a, row_b = np.zeros(layout.A_COLUMNS), np.zeros(layout.B_COLUMNS)
    ground = (chunk, n, np.zeros(3), np.zeros(3), 0.0, 0.0, 1.55)
    moving = (axis, logw, normals * 0, n, still, still, still, draws[:3] * 0)
    calls: dict[str, tuple[int, Callable[..., object], tuple[object, ...]]] = {
        "nine normals": (9, fill_normals, (lanes, normals[:n])),
        "copies of ancestors": (1, sense_pass._inherit, (source.reshape(-1), ancestors, chunk)),
        "motion, GNSS, acceleration": (3, sense_pass._move_axis, moving),
        "heading, pitch": (1, sense_pass._weigh_pitch, (chunk, n, -0.4, 0.0, 0.0, 0.0)),
        "exp, moments for the map": (1, sense_pass._map_moments, (chunk, n, top, row_a)),
        "map, terrain": (1, locate_pass._weigh_road, ground),
        "exp, moments of attitude": (1, locate_pass._attitude_moments, (chunk, n, top, row_b)),
        "exp, moments of the state": (1, locate_pass._state_moments, (chunk, n, top, row_b)),
        "exp, weights": (1, locate_pass._fill_block, (logw, top, np.float32(1), out)),
    }
    return {name: 1e9 / n * times * _fastest(call, args) for name, (times, call, args) in calls.items()}


def _fastest(call: Callable[..., object], args: tuple[object, ...]) -> float:
    """Seconds of one call: the best of several rounds, since others may be using the machine."""
    call(*args)
    best = np.inf
    for _ in range(30):
        begin = time.perf_counter()
        for _ in range(100):
            call(*args)
        best = min(best, (time.perf_counter() - begin) / 100)
    return float(best)


def memory_gb_per_s() -> float:
    """What one core reads and writes per second in copying an array larger than the caches."""
    source = np.ones(16 << 20)
    target = np.empty_like(source)
    seconds = _fastest_of_ten(lambda: np.copyto(target, source))
    return 2 * source.nbytes / seconds / 1e9


def _fastest_of_ten(call: Callable[[], object]) -> float:
    best = np.inf
    for _ in range(10):
        begin = time.perf_counter()
        call()
        best = min(best, time.perf_counter() - begin)
    return float(best)


def bytes_per_particle() -> int:
    """What an epoch with resampling reads and writes of each particle's numbers, caches aside."""
    single, states, rows = 4, k.STATES, layout.ROWS
    copied = 2 * single * states  # read at the ancestor's place, written at the new one
    passed = single * (
        rows + rows + 1
    )  # written by the sensing pass, read by the locating one, which writes log weights
    drawn = 8 * 10  # weights, their ends, the sorted points, ancestors: each written and read, sums twice
    return copied + passed + drawn
