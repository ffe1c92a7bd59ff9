"""What a rider asks of a drive: distance, time, ascent and descent, the steepest stretch, climbs; as JSON.

Knows no route and no database.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from app.core.text import LENGTH_DIGITS, SLOPE_DIGITS
from app.drives.outputs.profile import Profile
from fusion.profile.climbs import Climb, Stretch, ascent, climbs, height_lines, steepest, turn_m


def ride_json(profile: Profile) -> dict[str, Any]:
    """The figures of a drive's whole profile, JSON-serialisable; unknown is null."""
    lines = height_lines(
        profile.distance_m, profile.alt_m, profile.alt_sigma_m, profile.grade_sigma_percent, profile.gap
    )
    climbed = ascent(lines)
    steep = steepest(lines)
    some = len(profile) > 0

    def metres(value: float) -> float | None:
        return _rounded(value, LENGTH_DIGITS) if lines else None

    return {
        "distance_m": _rounded(profile.distance_m[-1], LENGTH_DIGITS) if some else None,
        "duration_s": _rounded(profile.time_s[-1] - profile.time_s[0], 1) if some else None,
        "ascent_m": metres(climbed.up_m),
        "ascent_sigma_m": metres(climbed.up_sigma_m),
        "descent_m": metres(climbed.down_m),
        "descent_sigma_m": metres(climbed.down_sigma_m),
        "least_rise_m": max(map(turn_m, lines), default=None),
        "steepest": _stretch(profile, steep) if steep else None,
        "climbs": [_climb(profile, one) for one in climbs(lines)],
    }


def _stretch(profile: Profile, one: Stretch) -> dict[str, Any]:
    return {
        "from_m": _rounded(one.from_m, LENGTH_DIGITS),
        "to_m": _rounded(one.to_m, LENGTH_DIGITS),
        "percent": _rounded(one.percent, SLOPE_DIGITS),
        "sigma_percent": _rounded(one.sigma_percent, SLOPE_DIGITS),
        "name": _name(profile, one),
    }


def _climb(profile: Profile, one: Climb) -> dict[str, Any]:
    return {
        **_stretch(profile, one),
        "length_m": _rounded(one.to_m - one.from_m, LENGTH_DIGITS),
        "gain_m": _rounded(one.gain_m, LENGTH_DIGITS),
        "maximum_percent": _rounded(one.steepest.percent, SLOPE_DIGITS),
        "maximum_sigma_percent": _rounded(one.steepest.sigma_percent, SLOPE_DIGITS),
        "maximum_from_m": _rounded(one.steepest.from_m, LENGTH_DIGITS),
        "maximum_to_m": _rounded(one.steepest.to_m, LENGTH_DIGITS),
        "category": one.category,
    }


def _name(profile: Profile, one: Stretch) -> str | None:
    """Of the road on which most of the stretch lies; None: it has none."""
    rows = np.flatnonzero((profile.distance_m >= one.from_m) & (profile.distance_m <= one.to_m))
    share: dict[str | None, float] = {}
    for name, metres in zip(profile.road_name[rows[1:]], np.diff(profile.distance_m[rows]), strict=True):
        share[name] = share.get(name, 0.0) + metres
    return max(share, key=lambda name: share[name], default=None)


def _rounded(value: float, digits: int) -> float | None:
    return round(float(value), digits) if math.isfinite(value) else None


def _schema(kind: str, description: str) -> dict[str, Any]:
    return {"type": [kind, "null"], "description": description}


_STRETCH = {
    "from_m": _schema("number", "Where it begins, on `distance_m`."),
    "to_m": _schema("number", "Where it ends."),
    "percent": _schema("number", "Its mean grade in the direction of travel."),
    "sigma_percent": _schema("number", "One standard deviation at most; null where it is not known."),
    "name": _schema("string", "Of the road on which most of it lies."),
}
_CLIMB = _STRETCH | {
    "length_m": _schema("number", "From its foot to its top."),
    "gain_m": _schema("number", "Its top above its foot."),
    "maximum_percent": _schema("number", "Over its steepest 100 m; of all of it, where it is shorter."),
    "maximum_sigma_percent": _schema("number", "One standard deviation at most."),
    "maximum_from_m": _schema("number", "Where these begin."),
    "maximum_to_m": _schema("number", "Where they end."),
    "category": _schema("string", "HC, 1, 2, 3 or 4 by length times mean grade; null: below all of them."),
}


def _object(properties: dict[str, Any], description: str, kind: str | list[str] = "object") -> dict[str, Any]:
    return {
        "type": kind,
        "required": list(properties),
        "properties": properties,
        "description": description,
    }


RIDE_SCHEMA = _object(
    {
        "distance_m": _schema("number", "Of the whole profile, also where `points` thins it."),
        "duration_s": _schema("number", "From the first epoch to the last, stops among them."),
        "ascent_m": _schema(
            "number", "Climbed in all; rises and falls below `least_rise_m` are passed over."
        ),
        "ascent_sigma_m": _schema("number", "One standard deviation at most; null where it is not known."),
        "descent_m": _schema("number", "Descended in all."),
        "descent_sigma_m": _schema("number", "As of the ascent."),
        "least_rise_m": _schema("number", "2 where the method smooths heights along the road, else 10."),
        "steepest": _object(
            _STRETCH, "The steepest 100 m, up or down; null: none as long.", ["object", "null"]
        ),
        "climbs": {
            "type": "array",
            "items": _object(_CLIMB, "A climb."),
            "description": "In the order of driving.",
        },
    },
    "What a rider asks: the rules are in the reference of rides.",
)
_STEEP_EXAMPLE = {
    "from_m": 812.4,
    "to_m": 912.4,
    "percent": 9.3124,
    "sigma_percent": 0.3871,
    "name": "Talweg",
}
RIDE_EXAMPLE: dict[str, Any] = {
    "distance_m": 6240.3,
    "duration_s": 549.0,
    "ascent_m": 131.4,
    "ascent_sigma_m": 3.1,
    "descent_m": 98.2,
    "descent_sigma_m": 2.9,
    "least_rise_m": 2.0,
    "steepest": _STEEP_EXAMPLE,
    "climbs": [
        {
            "from_m": 420.0,
            "to_m": 1830.0,
            "percent": 6.1277,
            "sigma_percent": 0.0921,
            "name": "Talweg",
            "length_m": 1410.0,
            "gain_m": 86.4,
            "maximum_percent": 9.3124,
            "maximum_sigma_percent": 0.3871,
            "maximum_from_m": 812.4,
            "maximum_to_m": 912.4,
            "category": "4",
        }
    ],
}
