"""A Traccar server that hands positions on: ``forward.type`` is ``json``, ``forward.url`` the address
(traccar.org/forward, traccar.org/configuration-file).

Each request is one object with ``position`` and ``device``. ``speed`` is in knots, ``course`` in degrees, ``altitude``
in m; 0 where the tracker has none. Trackers send heights above sea level. ``accuracy`` 0 is unknown.
"""

from __future__ import annotations

from app.core.errors import BadRequestError
from app.core.messages import say
from app.drives.live.points import KNOT_MPS, Batch, scaled
from app.drives.live.senders.base import Message, Sender, mapping


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    document = mapping(message.json())
    position, device = mapping(document.get("position")), mapping(document.get("device"))
    if not position:
        raise BadRequestError(say("live.not_known"), field="position")
    if position.get("valid") is False:
        batch.refuse("valid", "false")
        return
    batch.add(
        device.get("uniqueId") or device.get("name") or position.get("deviceId"),
        position.get("fixTime") or position.get("deviceTime"),
        position.get("latitude"),
        position.get("longitude"),
        alt_msl_m=position.get("altitude") or None,
        h_acc_m=position.get("accuracy"),
        speed_mps=scaled(position.get("speed"), KNOT_MPS),
        heading_deg=position.get("course"),
    )


SENDER = Sender(
    "traccar",
    "Traccar",
    read,
    typed="<entry key='forward.type'>json</entry>\n<entry key='forward.url'>{address}</entry>",
)
