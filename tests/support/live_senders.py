"""Programs that send points, as their documentation has it, and a device that moves."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import httpx

from app.drives.live.points import KMH_MPS, KNOT_MPS, LivePoint
from app.drives.live.senders.base import Message

BEGAN_S = 1_764_231_300
"""2025-11-27, a quarter past eight in the morning."""
ANDROID, APPLE = "Owntracks-Android/gp/420412000", "OwnTracks/18.4.4 CFNetwork/1494 Darwin/23.4.0"


@dataclass(frozen=True)
class Sent:
    """A request that a program makes."""

    params: dict[str, Any] = field(default_factory=dict)
    content: bytes = b""
    headers: dict[str, str] = field(default_factory=dict)

    @property
    def message(self) -> Message:
        """As the service reads it."""
        query = {name: str(value) for name, value in self.params.items()}
        return Message(query, self.content, self.headers)

    def to(self, client: httpx.Client, path: str) -> httpx.Response:
        """Make it."""
        if self.content:
            return client.post(path, params=self.params, content=self.content, headers=self.headers)
        return client.get(path, params=self.params, headers=self.headers)


def way(n: int, *, begin_s: float = BEGAN_S, every_s: float = 2.0, first: int = 0) -> list[LivePoint]:
    """A vehicle at 15 m/s that climbs 3 %, with what a good phone measures."""
    return [
        LivePoint(
            time_us=round((begin_s + every_s * k) * 1e6),
            lat_deg=round(48.1 + 15 * every_s * (first + k) / 111_195, 7),
            lon_deg=8.2,
            alt_msl_m=None,
            height_ell_m=round(300.0 + 0.45 * every_s * k, 1),
            h_acc_m=4.0,
            v_acc_m=3.0,
            speed_mps=15.0,
            s_acc_mps=0.5,
            heading_deg=1.0,
            pressure_hpa=round(980.0 - 0.05 * every_s * k, 2),
        )
        for k in range(n)
    ]


def _json(document: Any, **headers: str) -> Sent:
    return Sent(
        content=json.dumps(document).encode(), headers={"Content-Type": "application/json", **headers}
    )


def _iso(point: LivePoint) -> str:
    return datetime.fromtimestamp(point.time_us / 1e6, UTC).isoformat(timespec="milliseconds")


def owntracks(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """A message each."""
    return [
        _json(
            {
                "_type": "location",
                "topic": f"owntracks/anna/{device}",
                "tid": "AN",
                "acc": p.h_acc_m,
                "vac": p.v_acc_m,
                "alt": p.height_ell_m,
                "batt": 71,
                "bs": 1,
                "cog": p.heading_deg,
                "conn": "m",
                "lat": p.lat_deg,
                "lon": p.lon_deg,
                "m": 2,
                "p": None if p.pressure_hpa is None else round(p.pressure_hpa / 10, 4),
                "t": "p",
                "tst": p.time_us // 1_000_000,
                "vel": round((p.speed_mps or 0) / KMH_MPS),
            },
            **{"User-Agent": ANDROID},
        )
        for p in points
    ]


def overland(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """Batches of twenty, with a visit among them."""
    features = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": [p.lon_deg, p.lat_deg]},
            "properties": {
                "timestamp": _iso(p),
                "altitude": p.height_ell_m,
                "speed": p.speed_mps,
                "horizontal_accuracy": p.h_acc_m,
                "vertical_accuracy": p.v_acc_m,
                "speed_accuracy": p.s_acc_mps,
                "course": p.heading_deg,
                "course_accuracy": -1,
                "motion": ["driving"],
                "battery_state": "charging",
                "battery_level": 0.89,
                "device_id": device,
                "wifi": "",
            },
        }
        for p in points
    ]
    visit = {
        "type": "Feature",
        "geometry": {"type": "Point", "coordinates": [8, 48]},
        "properties": {"action": "visit"},
    }
    return [_json({"locations": [*features[k : k + 20], visit]}) for k in range(0, len(features), 20)]


def traccar(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """What a server hands on."""
    return [
        _json(
            {
                "position": {
                    "id": 7,
                    "deviceId": 3,
                    "protocol": "teltonika",
                    "serverTime": _iso(p),
                    "deviceTime": _iso(p),
                    "fixTime": _iso(p),
                    "outdated": False,
                    "valid": True,
                    "latitude": p.lat_deg,
                    "longitude": p.lon_deg,
                    "altitude": p.height_ell_m,
                    "speed": (p.speed_mps or 0) / KNOT_MPS,
                    "course": p.heading_deg,
                    "address": None,
                    "accuracy": 0.0,
                    "network": None,
                    "attributes": {"ignition": True, "sat": 11, "motion": True},
                },
                "device": {"id": 3, "name": "bus 7", "uniqueId": device, "status": "online"},
            }
        )
        for p in points
    ]


def traccar_client(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """Release 9 and, every other, the one before."""
    agent = {"User-Agent": "Dalvik/2.1.0 (Linux; U; Android 14)"}
    newer = [
        _json(
            {
                "location": {
                    "timestamp": _iso(p),
                    "coords": {
                        "latitude": p.lat_deg,
                        "longitude": p.lon_deg,
                        "accuracy": p.h_acc_m,
                        "speed": p.speed_mps,
                        "heading": p.heading_deg,
                        "altitude": p.height_ell_m,
                    },
                    "is_moving": True,
                    "odometer": 12,
                    "event": "motionchange",
                    "battery": {"level": 0.7, "is_charging": False},
                    "activity": {"type": "in_vehicle"},
                    "extras": {},
                },
                "device_id": device,
            },
            **agent,
        )
        for p in points[::2]
    ]
    older = [
        Sent(
            {
                "id": device,
                "timestamp": p.time_us // 1_000_000,
                "lat": p.lat_deg,
                "lon": p.lon_deg,
                "speed": (p.speed_mps or 0) / KNOT_MPS,
                "bearing": p.heading_deg,
                "altitude": p.height_ell_m,
                "accuracy": p.h_acc_m,
                "batt": 70,
            },
            headers=agent,
        )
        for p in points[1::2]
    ]
    return [*newer, *older]


def osmand(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """A request each; times in milliseconds."""
    return [
        Sent(
            {
                "lat": p.lat_deg,
                "lon": p.lon_deg,
                "timestamp": p.time_us // 1000,
                "hdop": p.h_acc_m,
                "altitude": p.height_ell_m,
                "speed": p.speed_mps,
                "bearing": p.heading_deg,
                "id": device,
            }
        )
        for p in points
    ]


def gpslogger(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """As the page's address has it, every other as a JSON body."""
    fields = [
        {
            "lat": p.lat_deg,
            "lon": p.lon_deg,
            "time": _iso(p),
            "alt": p.height_ell_m,
            "spd": p.speed_mps,
            "acc": p.h_acc_m,
            "dir": p.heading_deg,
            "ser": device,
        }
        for p in points
    ]
    return [_json(one) if k % 2 else Sent(one) for k, one in enumerate(fields)]


def sensor_logger(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """Batches of ten with other sensors between."""
    sent = []
    for k in range(0, len(points), 10):
        payload: list[dict[str, Any]] = []
        for p in points[k : k + 10]:
            time_ns = p.time_us * 1000
            location = {
                "bearingAccuracy": 20,
                "speedAccuracy": p.s_acc_mps,
                "verticalAccuracy": p.v_acc_m,
                "horizontalAccuracy": p.h_acc_m,
                "speed": p.speed_mps,
                "bearing": p.heading_deg,
                "altitude": p.height_ell_m,
                "longitude": p.lon_deg,
                "latitude": p.lat_deg,
            }
            payload += [
                {"name": "accelerometer", "time": time_ns - 1000, "values": {"z": 0.1, "y": 0.2, "x": 0.3}},
                {
                    "name": "barometer",
                    "time": time_ns + 40_000_000,
                    "values": {"relativeAltitude": 0, "pressure": p.pressure_hpa},
                },
                {"name": "location", "time": time_ns, "values": location},
            ]
        sent.append(_json({"messageId": k, "sessionId": "s", "deviceId": device, "payload": payload}))
    return sent


def torque(points: Sequence[LivePoint], device: str) -> list[Sent]:
    """First what the sensors are called, then a request each."""
    common = {"eml": "", "v": "8", "session": BEGAN_S * 1000, "id": device}
    notices = [
        Sent({**common, "time": BEGAN_S * 1000, "userShortName0d": "Speed", "userUnit0d": "km/h"}),
        Sent({**common, "time": BEGAN_S * 1000, "kff1005": "0.0", "kff1006": "0.0", "kd": "0.0"}),
    ]
    return notices + [
        Sent(
            {
                **common,
                "time": p.time_us // 1000,
                "kff1005": p.lon_deg,
                "kff1006": p.lat_deg,
                "kff1001": (p.speed_mps or 0) / KMH_MPS,
                "kff1007": p.heading_deg,
                "kff1010": p.height_ell_m,
                "kff1239": p.h_acc_m,
                "kd": (p.speed_mps or 0) / KMH_MPS,
                "kc": 1800,
            }
        )
        for p in points
    ]


SAMPLES = {
    "owntracks": owntracks,
    "overland": overland,
    "gpslogger": gpslogger,
    "osmand": osmand,
    "traccar-client": traccar_client,
    "traccar": traccar,
    "sensor-logger": sensor_logger,
    "torque": torque,
}
"""By sender: the requests that it makes for points of a device."""
ABOVE_SEA = {"overland", "osmand", "traccar"}
"""Those whose heights are above sea level."""
