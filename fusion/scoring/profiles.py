"""Height profiles, and the surveyed one that others are measured by, along which every place is a distance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.errors import EmptyLogError
from fusion.frames import LocalProjection
from fusion.messages import say
from fusion.types import Floats

REFERENCE_GAP_M = 30.0
"""Between points of the reference that lie farther apart its heights are not known."""
PROFILE_GAP_M = 100.0
"""The same of a profile: routers give straight roads few points."""


@dataclass(frozen=True)
class Profile:
    """Heights of places in the order in which a road goes, (n,) each, NaN unknown.

    ``along_m``: metres along the road, as its source states them; else ``places_deg``, longitude and latitude, (n, 2);
    or both. Heights are above any one datum. ``sigma_m`` is one standard deviation of a height.
    """

    height_m: Floats
    along_m: Floats | None = None
    places_deg: Floats | None = None
    sigma_m: Floats | None = None


@dataclass(frozen=True)
class Heights:
    """Heights along a reference: ``along_m`` never falls, (n,) each; between points farther apart than ``gap_m`` they
    are not known."""

    along_m: Floats
    height_m: Floats
    gap_m: float

    @classmethod
    def of(cls, along_m: Floats, height_m: Floats, gap_m: float) -> Heights:
        """From points in any order, of which those with a NaN are left out."""
        known = np.isfinite(along_m) & np.isfinite(height_m)
        order = np.argsort(along_m[known], kind="stable")
        return cls(along_m[known][order], height_m[known][order], gap_m)

    def at(self, along_m: Floats) -> Floats:
        """Heights there, NaN where they are not known."""
        if len(self.along_m) < 2:
            return np.full(len(along_m), np.nan)
        after = np.clip(np.searchsorted(self.along_m, along_m), 1, len(self.along_m) - 1)
        before_m, after_m = self.along_m[after - 1], self.along_m[after]
        inside = (along_m >= before_m) & (along_m <= after_m)
        known = inside & ((after_m - before_m <= self.gap_m) | (along_m == before_m) | (along_m == after_m))
        return np.where(known, np.interp(along_m, self.along_m, self.height_m), np.nan)

    @property
    def known_m(self) -> float:
        """Of how much of the way the heights are known."""
        steps = np.diff(self.along_m)
        return float(np.sum(steps[steps <= self.gap_m]))


@dataclass(frozen=True)
class Reference:
    """A surveyed profile: ``heights`` along it; ``places_deg``, longitude and latitude, (n, 2), where its points have
    them; one sigma of its heights, metres, NaN where it does not say."""

    name: str
    heights: Heights
    places_deg: Floats | None
    sigma_m: float

    @property
    def along_m(self) -> Floats:
        """Of its points, (n,)."""
        return self.heights.along_m

    @classmethod
    def of(cls, name: str, profile: Profile) -> Reference:
        """What a profile says, its points without a height or a place left out; raises ``EmptyLogError`` if fewer than
        two are left, or all are apart."""
        along_m = along_of(profile)
        known = np.isfinite(along_m) & np.isfinite(profile.height_m)
        if np.count_nonzero(known) < 2:
            raise EmptyLogError(say("scoring.no_reference", name=name))
        order = np.flatnonzero(known)[np.argsort(along_m[known], kind="stable")]
        heights = Heights(along_m[order], profile.height_m[order], REFERENCE_GAP_M)
        if not heights.known_m:
            raise EmptyLogError(say("scoring.sparse", name=name, most=REFERENCE_GAP_M))
        places = None if profile.places_deg is None else profile.places_deg[order]
        sigma = np.full(1, np.nan) if profile.sigma_m is None else profile.sigma_m[order]
        sigma_m = (
            float(np.sqrt(np.mean(sigma[np.isfinite(sigma)] ** 2))) if np.isfinite(sigma).any() else np.nan
        )
        return cls(name, heights, places, sigma_m)


def along_of(profile: Profile) -> Floats:
    """Metres along a profile by itself, (n,), NaN where it has no place: as stated, else along its own line."""
    if profile.along_m is not None:
        return profile.along_m
    if profile.places_deg is None:
        return np.full(len(profile.height_m), np.nan)
    lon, lat = profile.places_deg.T
    x, y = LocalProjection.around(lon, lat).to_xy(lon, lat)
    known = np.isfinite(x)
    along = np.full(len(x), np.nan)
    along[known] = np.r_[0.0, np.cumsum(np.hypot(np.diff(x[known]), np.diff(y[known])))]
    return along
