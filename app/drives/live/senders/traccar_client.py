"""Traccar Client, the phone app (traccar.org/osmand): from release 9 on JSON, before that fields of the address.

JSON: ``location.coords`` with ``speed`` in m/s, -1 for what is unknown. Fields: ``speed`` in knots, ``timestamp`` in
Unix seconds or milliseconds, ``accuracy`` in m, ``bearing`` in degrees. Heights are those of the phone's system.
"""

from __future__ import annotations

from app.drives.live.points import KNOT_MPS, Batch, scaled
from app.drives.live.senders.base import Message, Sender, mapping


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    fields = message.fields()
    if "location" in fields:
        location = mapping(fields["location"])
        coords = mapping(location.get("coords"))
        batch.add(
            fields.get("device_id"),
            location.get("timestamp"),
            coords.get("latitude"),
            coords.get("longitude"),
            h_acc_m=coords.get("accuracy"),
            v_acc_m=coords.get("altitude_accuracy"),
            speed_mps=coords.get("speed"),
            s_acc_mps=coords.get("speed_accuracy"),
            heading_deg=coords.get("heading"),
            **message.height(coords.get("altitude")),
        )
        return
    batch.add(
        fields.get("id") or fields.get("deviceid"),
        fields.get("timestamp"),
        fields.get("lat"),
        fields.get("lon"),
        h_acc_m=fields.get("accuracy"),
        speed_mps=scaled(fields.get("speed"), KNOT_MPS),
        heading_deg=fields.get("bearing") or fields.get("heading"),
        **message.height(fields.get("altitude")),
    )


SENDER = Sender("traccar-client", "Traccar Client", read, insists=True)
