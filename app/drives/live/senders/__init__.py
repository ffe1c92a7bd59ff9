"""The programs that send points: one file each, one line here."""

from __future__ import annotations

from app.drives.live.senders import (
    gpslogger,
    osmand,
    overland,
    owntracks,
    sensor_logger,
    torque,
    traccar,
    traccar_client,
)
from app.drives.live.senders.base import Sender

SENDERS: dict[str, Sender] = {
    module.SENDER.name: module.SENDER
    for module in (
        owntracks,
        overland,
        gpslogger,
        osmand,
        traccar_client,
        traccar,
        sensor_logger,
        torque,
    )
}
"""By name, those for phones in front."""
