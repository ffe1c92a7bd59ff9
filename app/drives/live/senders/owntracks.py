"""OwnTracks in HTTP mode (owntracks.org/booklet: tech/http, tech/json).

Each request is one JSON object; its ``_type`` says what it is, and only ``location`` has a place. Empty bodies come
where a friend was deleted. Units: ``vel`` km/h, ``alt`` and accuracies m, ``p`` kPa, ``tst`` Unix seconds. The booklet
calls ``alt`` above sea level; the app for Android hands on the system's height above the ellipsoid. The app sends the
next message only when this one was answered well, and reads a list of JSON objects in the answer.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from app.drives.live.points import KMH_MPS, Batch, scaled
from app.drives.live.senders.base import Message, Sender, objects


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    document = message.json()
    for one in objects(document) if document is not None else ():
        if one.get("_type") == "encrypted":
            batch.refuse("encrypted", "switch encryption off")
        elif one.get("_type") == "location":
            batch.add(
                _device(message, one),
                one.get("tst"),
                one.get("lat"),
                one.get("lon"),
                h_acc_m=one.get("acc"),
                v_acc_m=one.get("vac"),
                speed_mps=scaled(one.get("vel"), KMH_MPS),
                heading_deg=one.get("cog"),
                pressure_hpa=scaled(one.get("p"), 10.0),
                **message.height(one.get("alt")),
            )


def _device(message: Message, one: Mapping[str, Any]) -> object:
    topic = str(one.get("topic") or "").rsplit("/", 1)[-1]
    return message.headers.get("x-limit-d") or message.query.get("d") or topic or one.get("tid")


def _link(address: str, device: str) -> str:
    """A configuration that the app takes over; ``mode`` 3 is HTTP."""
    settings = {"_type": "configuration", "mode": 3, "url": address, "deviceId": device, "monitoring": 2}
    inline = base64.b64encode(json.dumps(settings).encode()).decode()
    return f"owntracks:///config?inline={quote(inline, safe='')}"


SENDER = Sender("owntracks", "OwnTracks", read, "[]", "application/json", link=_link, insists=True)
