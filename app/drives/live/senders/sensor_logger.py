"""Sensor Logger, HTTP push (github.com/tszheichoi/awesome-sensor-logger: PUSHING.md, UNITS.md).

A message is ``messageId``, ``sessionId``, ``deviceId`` and ``payload``: readings with ``name``, ``time`` in nanoseconds
and ``values``. Used are ``location`` (m, m/s, degrees) and ``barometer`` (hPa), whose reading nearest in time goes with
a place. Accelerations are not: how the phone lies is told by hundreds of them a second, which belong into the recording
that the app keeps beside, to be uploaded as a file. Heights: Android's above the ellipsoid, Apple's above sea level.
"""

from __future__ import annotations

from bisect import bisect_left

from app.core.errors import BadRequestError
from app.core.messages import say
from app.drives.live.points import US, Batch, moment_us, number
from app.drives.live.senders.base import Message, Sender, mapping

NEAR_US = 2 * US
"""A pressure of longer ago, or later, is not that of the place."""


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    document = mapping(message.json())
    if not isinstance(document.get("payload"), list):
        raise BadRequestError(say("live.not_known"), field="payload")
    readings = [mapping(one) for one in document["payload"]]
    pressures = _pressures([one for one in readings if one.get("name") == "barometer"])
    for one in readings:
        if one.get("name") != "location":
            continue
        values = mapping(one.get("values")) or one
        batch.add(
            document.get("deviceId"),
            one.get("time"),
            values.get("latitude"),
            values.get("longitude"),
            h_acc_m=values.get("horizontalAccuracy"),
            v_acc_m=values.get("verticalAccuracy"),
            speed_mps=values.get("speed"),
            s_acc_mps=values.get("speedAccuracy"),
            heading_deg=values.get("bearing"),
            pressure_hpa=_nearest(pressures, moment_us(one.get("time"))),
            **message.height(values.get("altitude")),
        )


def _pressures(readings: list[object]) -> list[tuple[int, float]]:
    found = []
    for one in map(mapping, readings):
        values = mapping(one.get("values")) or one
        time_us, pressure_hpa = moment_us(one.get("time")), number(values.get("pressure"))
        if time_us is not None and pressure_hpa is not None:
            found.append((time_us, pressure_hpa))
    return sorted(found)


def _nearest(pressures: list[tuple[int, float]], time_us: int | None) -> float | None:
    if time_us is None:
        return None
    at = bisect_left(pressures, (time_us, 0.0))
    near = min(pressures[max(0, at - 1) : at + 1], key=lambda one: abs(one[0] - time_us), default=None)
    return near[1] if near is not None and abs(near[0] - time_us) <= NEAR_US else None


SENDER = Sender("sensor-logger", "Sensor Logger", read, "OK")
