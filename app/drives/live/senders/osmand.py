"""OsmAnd, online tracking of its trip recording (osmand.net/docs: plugins/trip-recording).

The address holds what is sent: {0} latitude, {1} longitude, {2} Unix milliseconds, {3} ``hdop``, which is the accuracy
in m, {4} altitude in m, {5} speed in m/s, {6} bearing. OsmAnd takes the geoid off a height before it hands it on: it is
above sea level.
"""

from __future__ import annotations

from app.drives.live.points import Batch
from app.drives.live.senders.base import Message, Sender


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    fields = message.fields()
    batch.add(
        fields.get("id") or fields.get("device"),
        fields.get("timestamp"),
        fields.get("lat"),
        fields.get("lon"),
        alt_msl_m=fields.get("altitude"),
        h_acc_m=fields.get("hdop"),
        speed_mps=fields.get("speed"),
        heading_deg=fields.get("bearing"),
    )


_TYPED = "{address}?lat={0}&lon={1}&timestamp={2}&hdop={3}&altitude={4}&speed={5}&bearing={6}"
SENDER = Sender("osmand", "OsmAnd", read, "OK", typed=_TYPED)
