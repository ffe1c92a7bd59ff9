"""Logs with bad epochs: what receivers, clocks and mounts do wrong for some seconds, added to a clean log.

Each kind of dirt spoils bursts of epochs and leaves stated accuracies as they are. Velocities and altitudes err as
those of a real receiver between high buildings did (``GrossErrors``); the sizes of the other kinds are chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from accuracy.logs import Columns, outside_blocks, read_columns
from fusion.frames import LocalProjection
from fusion.signals import gps_from_unix
from fusion.types import Bools, Floats, Ints

GROSS = 4.0
"""An error beyond so many robust sigmas is a gross one."""
STEP_M = 20.0
LATE_S = 1.0
KNOCK_DEG, KNOCK_MPS2 = 8.0, 3.0
"""One sigma of what a knock does to pitch and accelerations at an epoch."""
_MAD_TO_SIGMA = 1.4826
_WEEK_S = 604_800.0
_SENSORS = ("acc_x_mps2", "acc_y_mps2", "acc_z_mps2", "pitch_deg", "roll_deg", "yaw_deg", "odo_speed_mps")


class GrossErrors(NamedTuple):
    """Errors beyond four robust sigmas in the order of time: velocities in sigmas, altitudes in metres."""

    horizontal: Floats
    vertical: Floats
    altitude_m: Floats


class Receiver(NamedTuple):
    """Sigmas of a receiver's velocities, m/s."""

    horizontal_mps: float
    vertical_mps: float


class Kind(NamedTuple):
    """A kind of dirt: how long its bursts are, and what happens in them."""

    burst_s: tuple[float, float]
    spoil: Callable[[Spoiling], None]
    measured: bool = False
    """Whether its sizes are those of a real receiver, which may not be there."""


class Spoiling(NamedTuple):
    """The columns that are being spoilt, in place, and where."""

    columns: Columns
    bursts: list[Ints]
    """The epochs of each."""
    rng: np.random.Generator
    receiver: Receiver
    gross: GrossErrors | None


def spoilt(
    columns: Columns,
    kinds: dict[str, Kind],
    share: float,
    seed: int,
    receiver: Receiver,
    gross: GrossErrors | None,
) -> Columns:
    """A log of which a ``share`` of the epochs is bad, each of the kinds taking its part; bursts may fall together."""
    out = {name: values.copy() for name, values in columns.items()}
    for name, kind in kinds.items():
        rng = np.random.default_rng([seed, list(KINDS).index(name)])
        bad = ~outside_blocks(out["time_s"], share / len(kinds), kind.burst_s, rng)
        kind.spoil(Spoiling(out, list(_runs(bad)), rng, receiver, gross))
    return out


def read_gross_errors(folder: Path) -> GrossErrors:
    """The gross errors of ``log.csv`` by the precise track ``ref.csv``, whose times are seconds of the GPS week."""
    log, track = read_columns(folder / "log.csv"), read_columns(folder / "ref.csv")
    time_s = np.asarray(gps_from_unix(log["time_s"])) % _WEEK_S
    east, north = LocalProjection.around(track["lon_deg"], track["lat_deg"]).to_xy(
        track["lon_deg"], track["lat_deg"]
    )

    def error(name: str, true: Floats) -> Floats:
        return np.asarray(log[name] - np.interp(time_s, track["t_s"], true))

    def speed(place: Floats) -> Floats:
        return np.asarray(np.gradient(place, track["t_s"]))

    level = [gross_of(error("vel_n_mps", speed(north))), gross_of(error("vel_e_mps", speed(east)))]
    down, down_sigma = gross_of(error("vel_d_mps", -speed(track["alt_m"])))
    return GrossErrors(
        horizontal=np.concatenate([gross / sigma for gross, sigma in level]),
        vertical=down / down_sigma,
        altitude_m=gross_of(error("height_ell_m", track["alt_m"]))[0],
    )


def gross_of(errors: Floats) -> tuple[Floats, float]:
    """The errors farther from their median than ``GROSS`` robust sigmas, and that sigma."""
    known = errors[np.isfinite(errors)]
    off = known - np.median(known)
    sigma = _MAD_TO_SIGMA * float(np.median(np.abs(off)))
    return off[np.abs(off) > GROSS * sigma], sigma


def _doppler(log: Spoiling) -> None:
    """Velocities of gross errors, scaled to the receiver's sigma."""
    gross = _measured(log)
    for name, errors, sigma in (
        ("vel_n_mps", gross.horizontal, log.receiver.horizontal_mps),
        ("vel_e_mps", gross.horizontal, log.receiver.horizontal_mps),
        ("vel_d_mps", gross.vertical, log.receiver.vertical_mps),
    ):
        for burst in log.bursts:
            log.columns[name][burst] += sigma * _in_order(errors, len(burst), log.rng)


def _multipath(log: Spoiling) -> None:
    """Altitudes of gross errors: signs last, as they did there."""
    for burst in log.bursts:
        log.columns["alt_msl_m"][burst] += _in_order(_measured(log).altitude_m, len(burst), log.rng)


def _step(log: Spoiling) -> None:
    """Altitudes that jump and come back."""
    for burst in log.bursts:
        log.columns["alt_msl_m"][burst] += STEP_M * log.rng.choice((-1.0, 1.0))


def _late_positions(log: Spoiling) -> None:
    """What the receiver measured is late, or repeated from the epoch before the burst."""
    names = [name for name in log.columns if name != "time_s" and name not in _SENSORS]
    for burst in log.bursts:
        repeated = log.rng.random() < 0.5
        source = np.full(len(burst), max(burst[0] - 1, 0)) if repeated else _late(log, burst, LATE_S)
        _copy(log.columns, names, source, burst)


def _late_sensors(log: Spoiling) -> None:
    """The sensors' clock is late or early against the receiver's."""
    names = [name for name in _SENSORS if name in log.columns]
    for burst in log.bursts:
        source = _late(log, burst, LATE_S * log.rng.choice((-1.0, 1.0)))
        _copy(log.columns, names, source, burst)


def _knock(log: Spoiling) -> None:
    """The mount is knocked: pitch and accelerations are nobody's."""
    for name in ("pitch_deg", "acc_x_mps2", "acc_y_mps2", "acc_z_mps2"):
        size = KNOCK_DEG if name == "pitch_deg" else KNOCK_MPS2
        for burst in log.bursts:
            log.columns[name][burst] += size * log.rng.normal(size=len(burst))


KINDS = {
    "Doppler": Kind((0.5, 5.0), _doppler, measured=True),
    "altitude multipath": Kind((0.5, 5.0), _multipath, measured=True),
    "altitude steps": Kind((1e9, 1e9), _step),
    "late positions": Kind((2.0, 8.0), _late_positions),
    "late sensors": Kind((10.0, 30.0), _late_sensors),
    "knocks": Kind((0.5, 2.0), _knock),
}
"""A burst that is longer than the log ends where its share of epochs does: it is one, or goes on from the start."""


def _measured(log: Spoiling) -> GrossErrors:
    if log.gross is None:
        raise ValueError("this kind of dirt needs the errors of a real receiver")
    return log.gross


def _in_order(errors: Floats, count: int, rng: np.random.Generator) -> Floats:
    """So many errors one after another, from a random one on."""
    first = int(rng.integers(len(errors)))
    return errors[(first + np.arange(count)) % len(errors)]


def _late(log: Spoiling, burst: Ints, late_s: float) -> Ints:
    """The epochs of which a burst shows the measurements, by the nearest time."""
    time_s = log.columns["time_s"]
    middles = (time_s[1:] + time_s[:-1]) / 2
    return np.asarray(np.searchsorted(middles, time_s[burst] - late_s))


def _copy(columns: Columns, names: list[str], source: Ints, burst: Ints) -> None:
    for name in names:
        columns[name][burst] = columns[name][source]


def _runs(bad: Bools) -> Iterator[Ints]:
    """The bad epochs, those that follow each other in one."""
    rows = np.flatnonzero(bad)
    return iter(part for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(part))
