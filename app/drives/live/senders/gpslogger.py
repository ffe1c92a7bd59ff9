"""GPSLogger for Android, its custom URL (gpslogger.app, "Custom URL"): its user names what is sent.

Read are the names of the address that the page shows, others that people use, as query, form or JSON body. %SPD is in
m/s, %ALT in m above the ellipsoid (unless the app is told to subtract the geoid), %ACC in m, %DIR in degrees,
%TIMESTAMP in Unix seconds, %TIME after ISO 8601.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from app.drives.live.points import Batch
from app.drives.live.senders.base import Message, Sender, objects


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    if message.body.lstrip()[:1] == b"[":
        for one in objects(message.json()):
            _add(one, batch)
    else:
        _add(message.fields(), batch)


def _add(fields: Mapping[str, Any], batch: Batch) -> None:
    def named(*names: str) -> Any:
        return next((fields[name] for name in names if fields.get(name) not in {None, ""}), None)

    batch.add(
        named("device", "ser", "aid", "id"),
        named("time", "timestamp", "starttimestamp"),
        named("lat", "latitude"),
        named("lon", "longitude", "lng"),
        height_ell_m=named("alt", "altitude"),
        h_acc_m=named("acc", "accuracy"),
        speed_mps=named("spd", "speed", "s"),
        heading_deg=named("dir", "bearing", "direction"),
    )


_TYPED = "{address}?lat=%LAT&lon=%LON&time=%TIME&alt=%ALT&spd=%SPD&acc=%ACC&dir=%DIR&ser=%SER"
SENDER = Sender("gpslogger", "GPSLogger", read, "OK", typed=_TYPED, insists=True)
