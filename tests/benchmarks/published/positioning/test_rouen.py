"""The route of the simulated run: its length and speed, and velocities that are rates of positions, in ECEF."""

from __future__ import annotations

import numpy as np
import pytest

from published.positioning.rouen import ROUEN_EPOCHS, ROUEN_LENGTH_M, ride_along, stretch, winding_route

SPEED = ROUEN_LENGTH_M / (ROUEN_EPOCHS - 1)


def test_the_run_has_the_length_and_speed_of_the_thesis() -> None:
    ride = ride_along(winding_route(ROUEN_LENGTH_M, np.random.default_rng(1)), ROUEN_EPOCHS, SPEED)
    assert len(ride) == 594
    assert abs(SPEED * 3.6 - 50.0) < 0.05
    ground = np.hypot(*ride.local_mps[:, :2].T)
    np.testing.assert_allclose(ground, SPEED, rtol=0.01)
    turn = np.diff(np.unwrap(np.arctan2(ride.local_mps[:, 0], ride.local_mps[:, 1])))
    assert np.degrees(np.abs(turn)).max() > 8.0
    assert np.abs(turn).max() * SPEED < 8.0  # m/s2: tight, but on wheels


def test_velocity_is_the_rate_of_position_in_ecef() -> None:
    route = winding_route(400.0, np.random.default_rng(2))
    fine = ride_along(route, 300, SPEED, interval_s=0.05)
    rate = (fine.position_m[2:] - fine.position_m[:-2]) / 0.1
    np.testing.assert_allclose(fine.velocity_mps[1:-1], rate, atol=0.01)


def test_a_route_may_be_too_short() -> None:
    with pytest.raises(ValueError, match=r"the route is .* m long, 100 epochs at 20\.0 m/s take 1980 m"):
        ride_along(winding_route(500.0, np.random.default_rng(3)), 100, 20.0)


def test_a_stretch_has_its_ends() -> None:
    route = winding_route(500.0, np.random.default_rng(4))
    part = stretch(route, 100.5, 120.25)
    length = np.hypot(*np.diff(part[:, :2], axis=0).T).sum()
    assert abs(length - 19.75) < 0.01
