"""What a drive's sensors said along it, as columns: what charts show behind the profile. Knows no database."""

from __future__ import annotations

from typing import Any

import numpy as np

from app.core.text import LENGTH_DIGITS, SLOPE_DIGITS
from app.drives.outputs.columns import numbers
from app.drives.outputs.profile import Profile
from app.drives.outputs.profile_marks import sensed
from app.drives.outputs.thinning import thinned
from fusion.types import DrawnMeasurements, Ints

TIME_DIGITS = 3


def measurements_json(
    profile: Profile, measurements: DrawnMeasurements | None, points: int | None = None
) -> dict[str, Any]:
    """Each sensor's measurements on the axis of the profile, at most ``points`` of each; JSON-serialisable.

    Of more, the highest and the lowest of each of equal stretches stay (``thinning``). What lies where the profile
    knows no place is left out.
    """
    sensors = []
    for one in () if measurements is None else sensed(profile, measurements):
        rows: Ints | slice = slice(None)
        if points is not None:
            none = np.zeros(len(one.value), np.bool_)
            rows = thinned(points, one.along_m, (one.value,), none, none)
        sensors.append(
            {
                "name": one.name,
                "is_height": one.is_height,
                "shift_m": None if one.shift_m is None else round(one.shift_m, LENGTH_DIGITS),
                "along_m": numbers(one.along_m[rows], LENGTH_DIGITS),
                "time_s": numbers(one.time_s[rows], TIME_DIGITS),
                "value": numbers(one.value[rows], LENGTH_DIGITS if one.is_height else SLOPE_DIGITS),
            }
        )
    return {"sensors": sensors}


MEASUREMENTS_EXAMPLE: dict[str, Any] = {
    "drive_id": "3f1c9a52-8f0e-4b57-9d0a-5a9f6c1f0f11",
    "sensors": [
        {
            "name": "altitude",
            "is_height": True,
            "shift_m": 0.0,
            "along_m": [0.0, 11.2],
            "time_s": [1_795_161_310.0, 1_795_161_311.0],
            "value": [142.9, 144.6],
        },
        {
            "name": "doppler",
            "is_height": False,
            "shift_m": None,
            "along_m": [0.0, 11.2],
            "time_s": [1_795_161_310.0, 1_795_161_311.0],
            "value": [6.21, 7.04],
        },
    ],
}


def _numbers(description: str) -> dict[str, Any]:
    return {"type": "array", "items": {"type": "number"}, "description": description}


_SENSOR: dict[str, Any] = {
    "type": "object",
    "required": list(MEASUREMENTS_EXAMPLE["sensors"][0]),
    "properties": {
        "name": {
            "type": "string",
            "description": "`altitude`, `barometer` (drift taken off), `dem` (the elevation model), `doppler`, `pitch` "
            "and `specific force` (mount taken off).",
        },
        "is_height": {"type": "boolean", "description": "Heights, else grades in the direction of travel."},
        "shift_m": {
            "type": ["number", "null"],
            "description": "Heights that refer to something else than the profile does are to be moved by so much "
            "beside it; 0 where they roughly agree, null for grades.",
        },
        "along_m": _numbers("Where, on the axis of the profile's `distance_m`."),
        "time_s": _numbers("When, seconds since 1970, UTC."),
        "value": _numbers("Heights in m, grades in percent."),
    },
}
MEASUREMENTS_SCHEMA: dict[str, Any] = {
    "type": "object",
    "required": list(MEASUREMENTS_EXAMPLE),
    "properties": {
        "drive_id": {"type": "string", "format": "uuid"},
        "sensors": {
            "type": "array",
            "items": _SENSOR,
            "description": "Those that the log has and the method uses; none where the method tells of none.",
        },
    },
}
