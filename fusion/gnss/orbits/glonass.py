"""Orbits of GLONASS: broadcast states carried on by the equations of motion.

Source: GLONASS ICD (edition 5.1) appendix 3: fourth-order Runge-Kutta in PZ-90 with the oblateness J2 and the broadcast
accelerations of sun and moon held constant. Broadcast clocks have the relativity of the orbit in them already.
"""

from __future__ import annotations

import numpy as np

from fusion.compiled import compiled
from fusion.signals import GlonassEphemerides
from fusion.types import Floats, Ints

MU_M3PS2 = 3.986004418e14
"""PZ-90.11."""
AXIS_M = 6_378_136.0
J2 = 1.08262575e-3
RATE_RADPS = 7.292115e-5
STEP_S = 60.0
"""At this step the method's own error over half an hour is below a millimetre."""


def glonass_clock_s(eph: GlonassEphemerides, record: Ints, gps_s: Floats) -> Floats:
    """The satellite clock's lead, seconds (n,)."""
    return eph.clock_s[record] + eph.clock_rate[record] * (gps_s - eph.toe_s[record])


def glonass_states(
    eph: GlonassEphemerides, record: Ints, gps_s: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Places and velocities (n, 3) in ECEF of the moment, clock leads (s) and rates (n,), at GPS seconds (n,)."""
    state = np.column_stack([eph.position_m[record], eph.velocity_mps[record]])
    _carry(state, eph.acceleration_mps2[record], gps_s - eph.toe_s[record])
    return (
        state[:, :3].copy(),
        state[:, 3:].copy(),
        glonass_clock_s(eph, record, gps_s),
        eph.clock_rate[record],
    )


@compiled
def _carry(state: Floats, pull: Floats, since_s: Floats) -> None:
    """Carry states (n, 6) on by times (n,), in place."""
    slope, trial, total = np.empty(6), np.empty(6), np.empty(6)
    for row in range(len(state)):
        remaining_s = since_s[row]
        now = state[row]
        while abs(remaining_s) > 1e-9:
            step = min(max(remaining_s, -STEP_S), STEP_S)
            remaining_s -= step
            total[:] = 0.0
            trial[:] = now
            for stage in range(4):
                _slope(trial, pull[row], slope)
                total += slope * (1.0 if stage in (0, 3) else 2.0)
                trial[:] = now + slope * (step if stage == 2 else 0.5 * step)
            now += total * (step / 6.0)


@compiled
def _slope(state: Floats, pull: Floats, out: Floats) -> None:
    """The state's derivative in the turning frame."""
    x, y, z = state[0], state[1], state[2]
    square = x * x + y * y + z * z
    radius = np.sqrt(square)
    oblate = 1.5 * J2 * MU_M3PS2 * AXIS_M * AXIS_M / (square * square * radius)
    central = -MU_M3PS2 / (square * radius) - oblate * (1.0 - 5.0 * z * z / square)
    out[:3] = state[3:]
    out[3] = (central + RATE_RADPS * RATE_RADPS) * x + 2.0 * RATE_RADPS * state[4] + pull[0]
    out[4] = (central + RATE_RADPS * RATE_RADPS) * y - 2.0 * RATE_RADPS * state[3] + pull[1]
    out[5] = (central - 2.0 * oblate) * z + pull[2]
