"""The ground of the synthetic town: a random smooth field, a hill for the tunnel, a valley for bridges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.types import Floats

HALF_SIZE_M = 1000.0
"""The town reaches this far from its centre in either direction."""
GEOID_UNDULATION_M = 48.0
"""Height of EGM96 above WGS 84 assumed over the whole town."""
_HILL_XY_M = (-500.0, -160.0)
_VALLEY_X_M = 500.0
_TUNNEL_HILL_M = 25.0
_VALLEY_DEPTH_M = 16.0
_HILL_WIDTH_M = 145.0
"""One sigma of the Gaussian across the hill, as that of the valley beside it."""
_VALLEY_WIDTH_M = 85.0
_WAVES = 40
"""Plane waves whose sum is the random part."""
_ROUGHNESS = 0.030
"""Root mean square grade of the random part."""


@dataclass(frozen=True)
class Terrain:
    """Ground height above EGM96 over the town's plane (x east, y north, metres from its centre).

    The random part is a sum of plane waves (wavelengths 350 to 1500 m), so that height and gradient are
    smooth and known everywhere.
    """

    base_m: float
    tilt: Floats
    wave_x: Floats
    wave_y: Floats
    phase: Floats
    amplitude_m: Floats
    hill_m: float = _TUNNEL_HILL_M
    valley_m: float = _VALLEY_DEPTH_M

    @classmethod
    def random(cls, rng: np.random.Generator) -> Terrain:
        """Draw a terrain; its random part has a root mean square grade of 3 % in every direction together."""
        length_m = np.exp(rng.uniform(np.log(350.0), np.log(1500.0), _WAVES))
        direction = rng.uniform(0.0, 2 * np.pi, _WAVES)
        wave = 2 * np.pi / length_m
        grade = rng.uniform(0.5, 1.0, _WAVES) * _ROUGHNESS * np.sqrt(2 / _WAVES)
        return cls(
            base_m=float(rng.uniform(200.0, 320.0)),
            tilt=rng.normal(0.0, 0.01, 2),
            wave_x=wave * np.cos(direction),
            wave_y=wave * np.sin(direction),
            phase=rng.uniform(0.0, 2 * np.pi, _WAVES),
            amplitude_m=grade / wave,
        )

    def height(self, x_m: Floats, y_m: Floats) -> Floats:
        """Ground height in metres at points of any one shape."""
        x, y = np.asarray(x_m, float), np.asarray(y_m, float)
        z = self.base_m + self.tilt[0] * x + self.tilt[1] * y
        for a, kx, ky, p in zip(self.amplitude_m, self.wave_x, self.wave_y, self.phase, strict=True):
            z = z + a * np.sin(kx * x + ky * y + p)
        far2 = ((x - _HILL_XY_M[0]) ** 2 + (y - _HILL_XY_M[1]) ** 2) / _HILL_WIDTH_M**2
        z = z + self.hill_m * np.exp(-far2 / 2)
        across = (x - _VALLEY_X_M - 30.0 * np.sin(y / 260.0)) / _VALLEY_WIDTH_M
        return np.asarray(z - self.valley_m * np.exp(-(across**2) / 2))
