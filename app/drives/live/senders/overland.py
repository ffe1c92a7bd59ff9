"""Overland (github.com/aaronpk/Overland-iOS, README, "API"): batches of GeoJSON features.

``speed`` is in m/s, ``altitude`` in m above sea level (Core Location), times are ISO 8601; -1 stands for what is not
known. Beside places a batch may hold visits and trips, which are none. The app deletes a batch once the answer is
``{"result": "ok"}`` and sends it again and again before that.
"""

from __future__ import annotations

from urllib.parse import quote, urlencode

from app.core.errors import BadRequestError
from app.core.messages import say
from app.drives.live.points import Batch
from app.drives.live.senders.base import Message, Sender, mapping, sequence


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    document = mapping(message.json())
    if not isinstance(document.get("locations"), list):
        raise BadRequestError(say("live.not_known"), field="locations")
    for feature in map(mapping, document["locations"]):
        properties, geometry = mapping(feature.get("properties")), mapping(feature.get("geometry"))
        if properties.get("action") or geometry.get("type") != "Point":
            continue
        lon, lat, *_ = [*sequence(geometry.get("coordinates")), None, None]
        batch.add(
            properties.get("device_id"),
            properties.get("timestamp"),
            lat,
            lon,
            alt_msl_m=properties.get("altitude"),
            h_acc_m=properties.get("horizontal_accuracy"),
            v_acc_m=properties.get("vertical_accuracy"),
            speed_mps=properties.get("speed"),
            s_acc_mps=properties.get("speed_accuracy"),
            heading_deg=properties.get("course"),
        )


def _link(address: str, device: str) -> str:
    return f"overland://setup?{urlencode({'url': address, 'device_id': device}, quote_via=quote)}"


SENDER = Sender(
    "overland", "Overland", read, '{"result": "ok"}', "application/json", link=_link, insists=True
)
