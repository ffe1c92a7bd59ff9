"""Orbits by Kepler's elements with harmonic corrections: GPS, QZSS, Galileo and BeiDou.

Sources: IS-GPS-200 table 20-IV and section 20.3.3.3.3.1, IS-QZSS-PNT, Galileo OS SIS ICD 5.1.1, BeiDou OS B1I ICD 5.2.4
(user algorithm, with its own frame for geostationary satellites). Velocities are the exact derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.gnss.earth import EARTH_RATE_RADPS
from fusion.signals import BEIDOU, BEIDOU_LATE_S, GALILEO, LIGHT_MPS, SYSTEMS, WEEK_S, KeplerEphemerides
from fusion.types import Bools, Floats, Ints

MU_M3PS2 = np.full(len(SYSTEMS), 3.986005e14)
"""The earth's gravitational constant by system: WGS 84 as IS-GPS-200 has it; below, as the ICDs of others do."""
MU_M3PS2[[GALILEO, BEIDOU]] = 3.986004418e14
RATE_RADPS = np.full(len(SYSTEMS), EARTH_RATE_RADPS)
"""Rotation of the earth by system; BeiDou's CGCS2000 has fewer digits."""
RATE_RADPS[BEIDOU] = 7.292115e-5

GEO_TILT_RAD = np.radians(-5.0)
"""By this the frame is turned in which elements of geostationary BeiDou satellites are given."""
_LAST_OLD_GEO, _FIRST_NEW_GEO = 5, 59  # C01 to C05 and C59 to C63 are geostationary
_NEWTON_STEPS = 8  # from E = M, six reach the last digit up to an eccentricity of 0.3


@dataclass(frozen=True)
class _Plane:
    """A satellite in the plane of its orbit and that plane, with rates, (n,) each; lengths in m, angles in rad."""

    radius: Floats
    radius_rate: Floats
    latitude: Floats
    latitude_rate: Floats
    inclination: Floats
    inclination_rate: Floats
    anomaly: Floats
    anomaly_rate: Floats


def is_geostationary(system: Ints, number: Ints) -> Bools:
    """Whether elements are in BeiDou's frame for geostationary satellites, (n,)."""
    near = (number <= _LAST_OLD_GEO) | (number >= _FIRST_NEW_GEO)
    return np.asarray((system == BEIDOU) & near)


def kepler_clock_s(eph: KeplerEphemerides, record: Ints, gps_s: Floats) -> Floats:
    """The satellite clock's lead by its polynomial alone, seconds (n,): no relativity, no group delay."""
    since = gps_s - eph.toc_s[record]
    return eph.af0_s[record] + since * (eph.af1[record] + since * eph.af2_per_s[record])


def kepler_states(
    eph: KeplerEphemerides, record: Ints, gps_s: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Places and velocities (n, 3) in ECEF, clock leads (s) and their rates (n,), at GPS seconds (n,).

    ``record`` (n,) says by which ephemeris. ECEF is that of the moment ``gps_s``. The clock has the relativity of the
    orbit's eccentricity, and no group delay.
    """
    system = eph.system[record]
    mu, earth_rate = MU_M3PS2[system], RATE_RADPS[system]
    since = gps_s - eph.toe_s[record]
    plane = _in_plane(eph, record, since, mu)
    geostationary = is_geostationary(system, eph.number[record])
    node, node_rate = _node(eph, record, since, np.where(geostationary, 0.0, earth_rate), earth_rate)
    position, velocity = _placed(plane, node, node_rate)
    some = np.flatnonzero(geostationary)
    if len(some):
        position[some], velocity[some] = _from_tilted(
            position[some], velocity[some], earth_rate[some], since[some]
        )
    # IS-GPS-200 20.3.3.3.3.1: F = -2 sqrt(mu) / c^2, with each system's own mu.
    relativity = -2.0 * np.sqrt(mu) / LIGHT_MPS**2 * eph.eccentricity[record] * eph.root_a[record]
    age = gps_s - eph.toc_s[record]
    clock = kepler_clock_s(eph, record, gps_s) + relativity * np.sin(plane.anomaly)
    rate = eph.af1[record] + 2.0 * age * eph.af2_per_s[record]
    return position, velocity, clock, rate + relativity * np.cos(plane.anomaly) * plane.anomaly_rate


def _eccentric_anomaly(mean: Floats, eccentricity: Floats) -> Floats:
    """Kepler's equation by Newton, radians (n,)."""
    anomaly = mean.copy()
    for _ in range(_NEWTON_STEPS):
        miss = anomaly - eccentricity * np.sin(anomaly) - mean
        anomaly -= miss / (1.0 - eccentricity * np.cos(anomaly))
    return anomaly


def _in_plane(eph: KeplerEphemerides, record: Ints, since_s: Floats, mu: Floats) -> _Plane:
    e, axis = eph.eccentricity[record], eph.root_a[record] ** 2
    motion = np.sqrt(mu / axis) / axis + eph.delta_n_radps[record]
    anomaly = _eccentric_anomaly(eph.m0_rad[record] + motion * since_s, e)
    sine, cosine = np.sin(anomaly), np.cos(anomaly)
    anomaly_rate = motion / (1.0 - e * cosine)
    true = np.arctan2(np.sqrt(1.0 - e * e) * sine, cosine - e)
    true_rate = np.sqrt(1.0 - e * e) * anomaly_rate / (1.0 - e * cosine)
    twice = 2.0 * (true + eph.omega_rad[record])
    s2, c2 = np.sin(twice), np.cos(twice)

    def wave(sine_part: Floats, cosine_part: Floats) -> tuple[Floats, Floats]:
        s, c = sine_part[record], cosine_part[record]
        return s * s2 + c * c2, 2.0 * true_rate * (s * c2 - c * s2)

    along, along_rate = wave(eph.cus_rad, eph.cuc_rad)
    out, out_rate = wave(eph.crs_m, eph.crc_m)
    tilt, tilt_rate = wave(eph.cis_rad, eph.cic_rad)
    return _Plane(
        radius=axis * (1.0 - e * cosine) + out,
        radius_rate=axis * e * sine * anomaly_rate + out_rate,
        latitude=0.5 * twice + along,
        latitude_rate=true_rate + along_rate,
        inclination=eph.i0_rad[record] + eph.i_dot_radps[record] * since_s + tilt,
        inclination_rate=eph.i_dot_radps[record] + tilt_rate,
        anomaly=anomaly,
        anomaly_rate=anomaly_rate,
    )


def _node(
    eph: KeplerEphemerides, record: Ints, since_s: Floats, turning_radps: Floats, earth_rate: Floats
) -> tuple[Floats, Floats]:
    """Longitude of the ascending node and its rate (n,), in a frame that turns at ``turning_radps`` from toe on."""
    own_scale_s = eph.toe_s[record] - np.where(eph.system[record] == BEIDOU, BEIDOU_LATE_S, 0.0)
    rate = eph.omega_dot_radps[record] - turning_radps
    return eph.omega0_rad[record] + rate * since_s - earth_rate * np.remainder(own_scale_s, WEEK_S), rate


def _placed(plane: _Plane, node: Floats, node_rate: Floats) -> tuple[Floats, Floats]:
    """Places and velocities (n, 3) from the plane of the orbit to the frame of its node."""
    su, cu = np.sin(plane.latitude), np.cos(plane.latitude)
    x, y = plane.radius * cu, plane.radius * su
    x_rate = plane.radius_rate * cu - y * plane.latitude_rate
    y_rate = plane.radius_rate * su + x * plane.latitude_rate
    si, ci = np.sin(plane.inclination), np.cos(plane.inclination)
    flat, flat_rate = y * ci, y_rate * ci - y * si * plane.inclination_rate
    so, co = np.sin(node), np.cos(node)
    position = np.column_stack([x * co - flat * so, x * so + flat * co, y * si])
    velocity = np.column_stack(
        [
            x_rate * co - flat_rate * so - position[:, 1] * node_rate,
            x_rate * so + flat_rate * co + position[:, 0] * node_rate,
            y_rate * si + y * ci * plane.inclination_rate,
        ]
    )
    return position, velocity


def _from_tilted(
    position: Floats, velocity: Floats, earth_rate: Floats, since_s: Floats
) -> tuple[Floats, Floats]:
    """From BeiDou's frame of geostationary orbits to ECEF: Rz(rate x since) Rx(-5 degrees)."""
    s, c = np.sin(GEO_TILT_RAD), np.cos(GEO_TILT_RAD)
    tilt = np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])
    place, speed = position @ tilt.T, velocity @ tilt.T
    st, ct = np.sin(earth_rate * since_s), np.cos(earth_rate * since_s)

    def turned(v: Floats) -> Floats:
        return np.column_stack([v[:, 0] * ct + v[:, 1] * st, v[:, 1] * ct - v[:, 0] * st, v[:, 2]])

    out = turned(place)
    swept = np.column_stack([out[:, 1], -out[:, 0], np.zeros(len(out))]) * earth_rate[:, None]
    return out, turned(speed) + swept
