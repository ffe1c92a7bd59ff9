"""How a phone lies in its vehicle, estimated from its inertial sensors: which way is up, and which way is forward.

Up is where the specific force points on the whole; forward is the level direction in which it grows when the speed by
GNSS does, and left that in which it grows in bends to the left. Where this is not clear, the sensors are not used:
forces along a wrong axis would be taken for slopes. Some devices state forces with the opposite sign; then bends lie
on the wrong side.

A tilt that is left (a mean slope, a mean acceleration) is one more mount pitch, which the methods estimate.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.arrays import ColumnTable
from fusion.messages import say
from fusion.types import AngularRate, DeviceMotion, DriveLog, Floats, Ints, SpecificForce, ThreeAxes

Complexes = NDArray[np.complex128]
STANDARD_GRAVITY = 9.80665
_BLOCK_S = 20.0
"""Slopes and biases hardly change in this time: level directions are compared within it."""
_UP_BLOCK_S = 60.0
_SHORTEST_S = 20.0
_MOST_TURNED_DEG = 15.0
"""Hills of 12 % and long accelerations turn the mean force of a minute by less: more, and the phone was moved."""
_MOST_MOVED_SHARE = 0.1
_LONGEST_STEP_S = 2.5
"""Sparser velocities have lost the manoeuvres."""
_SLOWEST_MPS = 3.0
"""Slower, the course is noise."""
_LAGS_S = np.arange(-1.0, 1.55, 0.25)
_WORST_FORWARD_DEG = 3.0
"""One sigma of the forward direction from which on it is not used."""
_SCALE = (0.5, 1.5)
"""How large the force may be beside the change of velocity that it comes of."""
_LEAST_BLOCKS = 6
_CLEARLY = 0.1
"""By how much the better sign explains more, to be believed."""
_ALIKE = 0.5
"""Least correlation of the gyroscope with the course, to tell the sign."""
TURNED = "phone's axes turned into the vehicle's"


@dataclass(frozen=True)
class _Forward:
    """The angle from the first level axis to forward, its sigma, the share of the changes that it explains."""

    angle_rad: float
    sigma_rad: float
    explained: float
    clear: bool


def in_vehicle_axes(log: DriveLog) -> DriveLog:
    """The log with ``force`` and ``rate`` of its ``device``, as far as these can be told in the vehicle's axes.

    Says in ``warnings`` what was left out; logs with an inertial sensor of the vehicle's keep that.
    """
    device, log = log.device, replace(log, device=DeviceMotion())
    if not device:
        return log
    if len(log.force) or len(log.rate):
        return _warned(log, "phone.beside_vehicle")
    force = _with_gravity(device)
    why = _no_up(force)
    if why:
        return _warned(log, "phone.left_out", why=why)
    up = _up(force)
    changes = _changes(log)
    level = {sign: _axes(sign * up) for sign in (1, -1)}
    candidates = {sign: _forward(force, sign, axes, changes) for sign, axes in level.items()}
    sign, certain = _sign(device, up, candidates, changes)
    forward = candidates[sign]
    if not forward.clear:
        log = _warned(log, "phone.lies_unknown")
        return replace(log, rate=_turning(device.rate, level[sign][2])) if certain else log
    e1, e2, e3 = level[sign]
    ahead = np.cos(forward.angle_rad) * e1 + np.sin(forward.angle_rad) * e2
    body = np.array([ahead, np.cross(e3, ahead), e3])
    felt = sign * _stacked(force) @ body.T
    turned = _stacked(device.rate) @ body.T
    return replace(
        log,
        force=SpecificForce(force.time_s, *felt.T),
        rate=AngularRate(device.rate.time_s, *turned.T) if certain else AngularRate.empty(),
        repaired=log.repaired + Counter({TURNED: 1}),
    )


def _warned(log: DriveLog, key: str, **parameters: str) -> DriveLog:
    device = "device" if log.source_format == "fit" else "phone"  # of a camera or a watch
    return replace(log, warnings=(*log.warnings, say(key, device=device, **parameters)))


def _stacked(table: ThreeAxes) -> Floats:
    return np.column_stack([table.x, table.y, table.z])


def _with_gravity(device: DeviceMotion) -> ThreeAxes:
    """The specific force, m/s2, whichever way the device states it; without a sample where it cannot be told."""
    force = device.force
    if not len(force) and len(device.moved) and len(device.gravity):
        moved, gravity = device.moved, device.gravity
        inside = (moved.time_s >= gravity.time_s[0]) & (moved.time_s <= gravity.time_s[-1])
        moved = moved.take(inside)
        axes = (
            getattr(moved, n) + np.interp(moved.time_s, gravity.time_s, getattr(gravity, n)) for n in "xyz"
        )
        force = ThreeAxes(moved.time_s, *axes)
    force = force.take(np.isfinite(force.x + force.y + force.z))
    size = float(np.median(np.linalg.norm(_stacked(force), axis=1))) if len(force) else 0.0
    if 0.8 < size < 1.2:
        return ThreeAxes(force.time_s, *(getattr(force, n) * STANDARD_GRAVITY for n in "xyz"))
    return force


def _blocks(time_s: Floats, length_s: float) -> Ints:
    return np.unique(np.floor((time_s - time_s[0]) / length_s).astype(np.int64), return_inverse=True)[1]


def _means(value: Floats, block: Ints) -> Floats:
    """Means (k, 3) of rows (n, 3) in each block."""
    count = np.bincount(block)
    return np.column_stack([np.bincount(block, column) / count for column in value.T])


def _no_up(force: ThreeAxes) -> str:
    """Why it cannot be told which way is up, in words; empty if it can."""
    if not len(force):
        return say("phone.no_gravity")
    blocks = _means(_stacked(force), _blocks(force.time_s, _UP_BLOCK_S))
    size = np.linalg.norm(blocks, axis=1)
    if np.ptp(force.time_s) < _SHORTEST_S:
        return say("phone.short", seconds=np.ptp(force.time_s))
    if not 0.9 * STANDARD_GRAVITY < np.median(size) < 1.1 * STANDARD_GRAVITY:
        return say("phone.not_gravity", force=np.median(size))
    cosine = blocks @ _up(force) / np.maximum(size, 1e-9)
    if np.mean(cosine < np.cos(np.radians(_MOST_TURNED_DEG))) > _MOST_MOVED_SHARE:
        return say("phone.moved")
    return ""


def _up(force: ThreeAxes) -> Floats:
    """The unit vector along the force on the whole: the median of minutes, of which few may lie elsewhere."""
    middle = np.median(_means(_stacked(force), _blocks(force.time_s, _UP_BLOCK_S)), axis=0)
    return np.asarray(middle / max(float(np.linalg.norm(middle)), 1e-9))


def _axes(up: Floats) -> Floats:
    """Right-handed axes (3, 3) by rows: two that are level, and up."""
    lead = np.eye(3)[int(np.argmin(np.abs(up)))]
    first = lead - up * (lead @ up)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(up, first), up])


@dataclass(frozen=True)
class _Changes(ColumnTable):
    """Accelerations by GNSS between instants: ``felt`` is forward + 1j * left, m/s2; ``turn_radps`` anticlockwise."""

    begin_s: Floats
    end_s: Floats
    felt: Complexes
    turn_radps: Floats


def _changes(log: DriveLog) -> _Changes:
    velocity = log.velocity.take(np.isfinite(log.velocity.vel_n_mps + log.velocity.vel_e_mps))
    time, north, east = velocity.time_s, velocity.vel_n_mps, velocity.vel_e_mps
    speed, course = np.hypot(north, east), np.arctan2(east, north)  # clockwise
    lasted = np.diff(time)
    with np.errstate(divide="ignore", invalid="ignore"):
        forward = np.diff(speed) / lasted
        turn = -(np.remainder(np.diff(course) + np.pi, 2 * np.pi) - np.pi) / lasted
    fast = np.minimum(speed[1:], speed[:-1]) > _SLOWEST_MPS
    turn = np.where(fast, turn, 0.0)
    leftward = 0.5 * (speed[1:] + speed[:-1]) * turn
    keep = (lasted > 0.05) & (lasted < _LONGEST_STEP_S) & (np.maximum(speed[1:], speed[:-1]) > 0.5)
    return _Changes(time[:-1], time[1:], forward + 1j * leftward, turn).take(keep)


def _integrals(time_s: Floats, value: Floats) -> Floats:
    """The integral (n, k) of columns (n, k) from the first instant on."""
    steps = np.diff(time_s)[:, None] * 0.5 * (value[1:] + value[:-1])
    return np.vstack([np.zeros((1, value.shape[1])), np.cumsum(steps, axis=0)])


def _mean_over(time_s: Floats, integral: Floats, begin_s: Floats, end_s: Floats) -> Floats:
    """Mean (m, k) between instants of what was integrated."""
    ends = [np.column_stack([np.interp(at, time_s, c) for c in integral.T]) for at in (begin_s, end_s)]
    return np.asarray((ends[1] - ends[0]) / (end_s - begin_s)[:, None])


def _covered(changes: _Changes, sensor: ThreeAxes) -> _Changes:
    """Those through which a sensor has samples, from before to after, without a hole of more than a second."""
    if len(sensor) < 4:
        return changes.take(slice(0))
    time_s, spare = sensor.time_s, float(np.max(np.abs(_LAGS_S)))
    begin_s, end_s = changes.begin_s - spare, changes.end_s + spare
    holes = np.concatenate([[0], np.cumsum(np.diff(time_s) > 1.0)])
    first = np.clip(np.searchsorted(time_s, begin_s) - 1, 0, None)
    last = np.clip(np.searchsorted(time_s, end_s), None, len(time_s) - 1)
    inside = (begin_s >= time_s[0]) & (end_s <= time_s[-1])
    return changes.take(inside & (holes[first] == holes[last]))


NOT_CLEAR = _Forward(0.0, np.inf, 0.0, clear=False)


def _forward(force: ThreeAxes, sign: int, axes: Floats, changes: _Changes) -> _Forward:
    """Which level direction is forward, if forces are stated with ``sign``: a complex regression on the changes."""
    changes = _covered(changes, force)
    if len(changes) < 3 * _LEAST_BLOCKS:
        return NOT_CLEAR
    integral = _integrals(force.time_s, sign * _stacked(force) @ axes[:2].T)
    block = _blocks(changes.begin_s, _BLOCK_S)
    cause = _centred(changes.felt, block)
    best = NOT_CLEAR
    for lag_s in _LAGS_S:
        level = _mean_over(force.time_s, integral, changes.begin_s + lag_s, changes.end_s + lag_s)
        candidate = _regression(cause, _centred(level[:, 0] + 1j * level[:, 1], block), block)
        best = max(best, candidate, key=lambda one: one.explained)
    return best


def _centred(value: Complexes, block: Ints) -> Complexes:
    count = np.bincount(block)
    mean = (np.bincount(block, value.real) + 1j * np.bincount(block, value.imag)) / count
    return value - mean[block]


def _regression(cause: Complexes, effect: Complexes, block: Ints) -> _Forward:
    """``effect = factor * cause``, with a sigma of the factor's angle by leaving out each block in turn."""
    both = np.conj(cause) * effect
    product = np.bincount(block, both.real) + 1j * np.bincount(block, both.imag)
    power = np.bincount(block, np.abs(cause) ** 2)
    effect_power = np.bincount(block, np.abs(effect) ** 2)
    blocks = len(power)
    total, weight = product.sum(), float(power.sum())
    if blocks < _LEAST_BLOCKS or weight <= 0 or float(effect_power.sum()) <= 0:
        return NOT_CLEAR
    factor = total / weight
    without = total - product
    turned = np.angle(without * np.conj(total))
    sigma = float(np.sqrt((blocks - 1) / blocks * np.sum((turned - turned.mean()) ** 2)))
    explained = float(abs(total) ** 2 / (weight * effect_power.sum()))
    clear = sigma < np.radians(_WORST_FORWARD_DEG) and _SCALE[0] < abs(factor) < _SCALE[1]
    return _Forward(float(np.angle(factor)), sigma, explained, clear=clear)


def _sign(
    device: DeviceMotion, up: Floats, candidates: dict[int, _Forward], changes: _Changes
) -> tuple[int, bool]:
    """The sign with which the device states forces, and whether that is certain: by its gyroscope, or by bends."""
    alike = _turns_alike(device.rate, up, changes)
    if abs(alike) > _ALIKE:
        return (1 if alike > 0 else -1), True
    ahead = candidates[1].explained - candidates[-1].explained
    return (1 if ahead >= 0 else -1), abs(ahead) > _CLEARLY


def _turns_alike(rate: ThreeAxes, up: Floats, changes: _Changes) -> float:
    """Correlation of the rate about ``up`` with the turning by GNSS; 0 where there is too little of either."""
    changes = _covered(changes, rate)
    if len(changes) < 3 * _LEAST_BLOCKS:
        return 0.0
    integral = _integrals(rate.time_s, (np.nan_to_num(_stacked(rate)) @ up)[:, None])
    turned = _mean_over(rate.time_s, integral, changes.begin_s, changes.end_s)[:, 0]
    if not (np.std(turned) > 0.01 and np.std(changes.turn_radps) > 0.01):
        return 0.0
    return float(np.corrcoef(turned, changes.turn_radps)[0, 1])


def _turning(rate: ThreeAxes, up: Floats) -> AngularRate:
    """The rate about the vertical alone, which needs no forward direction."""
    return AngularRate.assemble(rate.time_s, None, gyr_z_radps=_stacked(rate) @ up)
