"""A drive through street canyons: what was measured, as corrected measurements or as raw signals, and all truth."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from fusion.frames import geodetic
from fusion.gnss.corrections import klobuchar_delay_m, troposphere_delay_m
from fusion.gnss.measurements import Measurements
from fusion.gnss.missing_navigation import NAMES
from fusion.gnss.reception import NLOS
from fusion.published.canyon.fronts import Fronts, fronts_of_town
from fusion.published.canyon.radio import TOWN, Clock, Radio, receive, run_clock, system_biases
from fusion.published.canyon.ride import Ride, ride_of
from fusion.published.canyon.sight import trace
from fusion.published.canyon.sky import Sky, look_up, names_of, synthetic_navigation
from fusion.signals import LIGHT_MPS, Navigation, RawGnss, Signals
from fusion.simulate.drive import SimulatedDrive
from fusion.types import Bools, Floats, Ints


@dataclass(frozen=True)
class CanyonDrive:
    """Rows (n,) of tracked satellites in m epochs. ``sky`` holds the geometry, ``clock`` the receiver's own clock.

    ``state`` is the true reception state (1 direct, 2 reflected); ``error_m`` and ``error_mps`` are the true errors of
    pseudorange and range rate, detour included; ``system_bias_m`` is each row's bias against the first system.
    ``above`` (m,) counts the satellites above the horizon's mask, tracked or not.
    """

    ride: Ride
    fronts: Fronts
    navigation: Navigation
    sky: Sky
    clock: Clock
    state: Ints
    cn0_dbhz: Floats
    error_m: Floats
    error_mps: Floats
    system_bias_m: Floats
    above: Ints

    @property
    def reflected(self) -> Bools:
        """Rows whose direct ray is blocked, (n,)."""
        return np.asarray(self.state == NLOS)

    def measurements(self) -> Measurements:
        """As solvers take them: satellite clock, atmosphere and jumps of the receiver's clock are gone."""
        sky, epoch = self.sky, self.sky.epoch
        distance, closing = self._geometry()
        names, satellite = names_of(sky.system, sky.number)
        systems, group = np.unique(sky.system, return_inverse=True)
        rows = len(epoch)
        return Measurements(
            time_s=self.ride.time_s,
            first=sky.first,
            satellite=satellite,
            group=np.asarray(group, np.int64).ravel(),
            pseudorange_m=distance + self.clock.bias_m[epoch] + self.system_bias_m + self.error_m,
            range_rate_mps=closing + self.clock.drift_mps[epoch] + self.error_mps,
            cn0_dbhz=self.cn0_dbhz,
            sigma_m=np.full(rows, np.nan),
            elevation_rad=sky.elevation_rad,
            azimuth_rad=sky.azimuth_rad,
            satellite_m=sky.satellite_m,
            satellite_mps=sky.satellite_mps,
            names=names,
            groups=tuple(NAMES[s] for s in systems),
            rough_m=self.ride.position_m[0],
        )

    def signals(self) -> Signals:
        """As a receiver writes them down, on its own clock, atmosphere and satellite clocks included.

        The atmosphere is that of the corrections' models: what they leave is not simulated.
        """
        sky, epoch = self.sky, self.sky.epoch
        distance, closing = self._geometry()
        clock_m = self.clock.bias_m + self.clock.jump_m
        pseudorange = distance + clock_m[epoch] + self.system_bias_m - LIGHT_MPS * sky.clock_s
        rate = closing + self.clock.drift_mps[epoch] - LIGHT_MPS * sky.clock_drift
        rows = len(epoch)
        return Signals(
            gps_s=self.ride.gps_s + clock_m / LIGHT_MPS,
            first=sky.first,
            system=sky.system,
            number=sky.number,
            pseudorange_m=pseudorange + self._atmosphere_m() + self.error_m,
            range_rate_mps=rate + self.error_mps,
            cn0_dbhz=self.cn0_dbhz,
            sigma_m=np.full(rows, np.nan),
            frequency_hz=sky.carrier_hz,
            position_m=np.full((rows, 3), np.nan),
            velocity_mps=np.full((rows, 3), np.nan),
        )

    def raw(self) -> RawGnss:
        """Signals and navigation, as a log brings them."""
        return RawGnss(self.signals(), self.navigation)

    def _atmosphere_m(self) -> Floats:
        """What ionosphere (none without coefficients) and troposphere add to each row."""
        sky, epoch = self.sky, self.sky.epoch
        gps_s = self.ride.gps_s[epoch]
        lon_deg, lat_deg, height_m = geodetic(self.ride.position_m)
        lon, lat = np.radians(lon_deg)[epoch], np.radians(lat_deg)[epoch]
        delay = troposphere_delay_m(gps_s, lat, height_m[epoch], sky.elevation_rad)
        if self.navigation.klobuchar is None:
            return delay
        return delay + klobuchar_delay_m(
            self.navigation.klobuchar, gps_s, lat, lon, sky.elevation_rad, sky.azimuth_rad, sky.carrier_hz
        )

    def _geometry(self) -> tuple[Floats, Floats]:
        """Distance of each row's satellite and its rate, without any clock."""
        epoch = self.sky.epoch
        sight = self.sky.satellite_m - self.ride.position_m[epoch]
        distance = np.linalg.norm(sight, axis=1)
        speed = self.sky.satellite_mps - self.ride.velocity_mps[epoch]
        return distance, np.einsum("ni,ni->n", speed, sight) / distance


def simulate_canyon(
    ride: Ride,
    fronts: Fronts,
    radio: Radio,
    navigation: Navigation,
    rng: np.random.Generator,
    *,
    has_gnss: Bools | None = None,
) -> CanyonDrive:
    """Measure the satellites of ``navigation`` along a ride; nothing where ``has_gnss`` (m,) is False."""
    sky = look_up(navigation, ride.gps_s, ride.position_m)
    sight = trace(fronts, sky.epoch, ride.local_m, ride.local_mps, sky.elevation_rad, sky.azimuth_rad)
    interval_s = float(np.median(np.diff(ride.time_s))) if len(ride) > 1 else 1.0
    got = receive(sky, sight, fronts, radio, interval_s, rng)
    tracked = got.kept if has_gnss is None else got.kept & has_gnss[sky.epoch]
    bias = system_biases(sky.system, radio, rng)
    return CanyonDrive(
        ride=ride,
        fronts=fronts,
        navigation=navigation,
        sky=_taken(sky, tracked),
        clock=run_clock(len(ride), interval_s, radio, rng),
        state=sight.state[tracked],
        cn0_dbhz=got.cn0_dbhz[tracked],
        error_m=got.error_m[tracked],
        error_mps=got.error_mps[tracked],
        system_bias_m=np.array([bias[s] for s in sky.system[tracked].tolist()], float),
        above=np.diff(sky.first),
    )


def _taken(sky: Sky, tracked: Bools) -> Sky:
    """The rows that a mask selects; epochs stay, if without rows."""
    counts = np.bincount(sky.epoch[tracked], minlength=len(sky.first) - 1)
    columns = {s.name: getattr(sky, s.name)[tracked] for s in fields(Sky) if s.name != "first"}
    return Sky(first=np.append(0, np.cumsum(counts)), **columns)


def canyon_of(
    drive: SimulatedDrive,
    radio: Radio = TOWN,
    navigation: Navigation | None = None,
    everywhere: str | None = None,
) -> CanyonDrive:
    """What a receiver of raw signals measures on a drive through a town; fronts and sky come from the town's seed.

    Without ``navigation`` a sky of GPS, Galileo and BeiDou satellites is made. In tunnels nothing is tracked.
    ``everywhere`` as ``fronts_of_town`` has it.
    """
    ride = ride_of(drive)
    fronts = fronts_of_town(drive.town, np.random.default_rng([drive.town.seed, 121]), everywhere)
    if navigation is None:
        sky_rng = np.random.default_rng([drive.town.seed, drive.seed, 122])
        navigation = synthetic_navigation(
            float(ride.gps_s[0]), float(ride.time_s[-1] - ride.time_s[0]), sky_rng
        )
    rng = np.random.default_rng([drive.town.seed, drive.seed, 123])
    return simulate_canyon(ride, fronts, radio, navigation, rng, has_gnss=drive.has_gnss)
