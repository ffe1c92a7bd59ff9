"""What a receiver makes of rays: C/N0, errors of pseudorange and Doppler, and its clock.

Every figure of a ``Radio`` that no source gives is an ordinary receiver's, chosen by us before any solver ran.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fusion.gnss.reception import LOS, NLOS, open_sky_dbhz
from fusion.published.canyon.fronts import Fronts
from fusion.published.canyon.sight import Sight
from fusion.published.canyon.sky import Sky
from fusion.signals import LIGHT_MPS
from fusion.simulate.receiver.readings import gauss_markov
from fusion.types import Bools, Floats, Ints

_STRONG_DBHZ = 45.0
"""C/N0 at which noises are as stated; they double for each 6 dB less where they follow it."""
_QUIET_SHARE = 0.2
"""Share of the multipath error that is left where no reflection is near."""
_JUMPS_MS = np.array([-2, -1, 1, 2])


class Radio(NamedTuple):
    """The figures of a receiver; sigmas are one standard deviation, times those of exponential correlation.

    ``noise_m`` and ``doppler_mps`` are white; with ``noise_follows_cn0`` they grow as C/N0 falls below 45 dB-Hz.
    ``multipath_m`` is the correlated error of a direct ray that a reflection joins. ``loss_db`` is what any reflection
    takes off C/N0, NaN for each front's own. What is weaker than ``lost_below_dbhz`` is not tracked. The clock starts
    with ``drift_mps`` times a normal number, and its drift walks by ``drift_walk_mps`` per root second; ``jumps`` times
    in the drive it is set by n x 1 ms. ``system_m`` is one sigma of the biases between systems.
    """

    noise_m: float
    noise_follows_cn0: bool
    multipath_m: float
    multipath_s: float
    doppler_mps: float
    cn0_sigma_db: float
    fading_db: float
    fading_s: float
    loss_db: float
    lost_below_dbhz: float
    drift_mps: float
    drift_walk_mps: float
    system_m: float
    jumps: int


TOWN = Radio(0.6, True, 1.5, 4.0, 0.05, 1.0, 2.0, 3.0, np.nan, 24.0, 30.0, 0.05, 10.0, 0)
"""A low-cost receiver with its clock."""


@dataclass(frozen=True)
class Reception:
    """What the receiver measures of each row (n,) beside the geometry; ``kept`` says which rows it tracks.

    ``error_m`` and ``error_mps`` are all that pseudorange and range rate have beyond geometry, clocks and atmosphere.
    """

    kept: Bools
    cn0_dbhz: Floats
    error_m: Floats
    error_mps: Floats


@dataclass(frozen=True)
class Clock:
    """The receiver's clock at each epoch (m,), in metres: smooth part, its rate, and the jumps beside it."""

    bias_m: Floats
    drift_mps: Floats
    jump_m: Floats


def receive(
    sky: Sky, sight: Sight, fronts: Fronts, radio: Radio, interval_s: float, rng: np.random.Generator
) -> Reception:
    """Draw what is measured of each ray."""
    slow, fading = _drawn_by_satellite(sky, radio, interval_s, rng)
    n = len(sight.state)
    reflected = sight.state == NLOS
    cn0 = open_sky_dbhz(sky.elevation_rad)
    cn0 = cn0 + fading + radio.cn0_sigma_db * rng.normal(size=n)
    cn0 = cn0 - np.where(reflected, _losses(sight, fronts, radio), 0.0)
    weak = 10 ** ((_STRONG_DBHZ - cn0) / 20) if radio.noise_follows_cn0 else np.ones(n)
    echo = np.isfinite(sight.detour_m)
    error = radio.noise_m * weak * rng.normal(size=n) + np.where(echo, 1.0, _QUIET_SHARE) * slow
    rate = radio.doppler_mps * weak * rng.normal(size=n)
    tracked = (reflected | (sight.state == LOS)) & (cn0 >= radio.lost_below_dbhz)
    return Reception(
        kept=tracked,
        cn0_dbhz=cn0,
        error_m=error + np.where(reflected, sight.detour_m, 0.0),
        error_mps=rate + np.where(reflected, sight.detour_mps, 0.0),
    )


def _losses(sight: Sight, fronts: Fronts, radio: Radio) -> Floats:
    """What the reflection of each row costs; NaN where there is none."""
    if np.isfinite(radio.loss_db):
        return np.full(len(sight.front), radio.loss_db)
    own = np.append(fronts.loss_db, np.nan)
    return np.asarray(own[sight.front])


def _drawn_by_satellite(
    sky: Sky, radio: Radio, interval_s: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Multipath (m) and fading (dB) of each row, correlated in time along each satellite."""
    epoch, epochs = sky.epoch, len(sky.first) - 1
    key: Ints = sky.system * 1000 + sky.number
    slow, fading = np.zeros(len(key)), np.zeros(len(key))
    for satellite in np.unique(key):
        rows = key == satellite
        slow[rows] = gauss_markov(epochs, interval_s, radio.multipath_m, radio.multipath_s, rng)[epoch[rows]]
        fading[rows] = gauss_markov(epochs, interval_s, radio.fading_db, radio.fading_s, rng)[epoch[rows]]
    return slow, fading


def run_clock(epochs: int, interval_s: float, radio: Radio, rng: np.random.Generator) -> Clock:
    """Draw the receiver's clock."""
    walk = radio.drift_walk_mps * np.sqrt(interval_s) * rng.normal(size=epochs)
    drift = radio.drift_mps * rng.normal() + np.cumsum(walk)
    bias = np.concatenate([[0.0], np.cumsum(0.5 * (drift[1:] + drift[:-1]) * interval_s)])
    jump = np.zeros(epochs)
    if radio.jumps:
        at = rng.choice(np.arange(1, epochs), min(radio.jumps, epochs - 1), replace=False)
        jump[at] = rng.choice(_JUMPS_MS, len(at)) * 1e-3 * LIGHT_MPS
    return Clock(bias, drift, np.cumsum(jump))


def system_biases(systems: Ints, radio: Radio, rng: np.random.Generator) -> dict[int, float]:
    """The bias (m) of each system against the first of them."""
    names = np.unique(systems).tolist()
    return {s: 0.0 if k == 0 else float(radio.system_m * rng.normal()) for k, s in enumerate(names)}
