"""Torque Pro, its web server upload (torque-bhp.com/wiki/Upload_Format_to_Webserver).

Fields of the address: ``kff1006`` latitude, ``kff1005`` longitude, ``kff1001`` speed of the receiver in km/h, ``kd``
speed of the vehicle in km/h, ``kff1007`` bearing, ``kff1010`` altitude in m (Android's, above the ellipsoid),
``kff1239`` accuracy in m, ``time`` in Unix milliseconds, ``id`` of the device. Other requests tell units and names of
sensors, or have no place yet: they hold no point. The vehicle's barometer is not used: it tells whole kPa, 80 m.
The program waits for ``OK!``.
"""

from __future__ import annotations

from app.drives.live.points import KMH_MPS, Batch, number, scaled
from app.drives.live.senders.base import Message, Sender


def read(message: Message, batch: Batch) -> None:
    """See ``Sender``."""
    fields = message.fields()
    lat, lon = fields.get("kff1006"), fields.get("kff1005")
    if lat is None or lon is None or number(lat) == number(lon) == 0:
        return
    batch.add(
        fields.get("id"),
        fields.get("time"),
        lat,
        lon,
        height_ell_m=fields.get("kff1010"),
        h_acc_m=fields.get("kff1239"),
        speed_mps=scaled(fields.get("kff1001"), KMH_MPS),
        heading_deg=fields.get("kff1007"),
        odo_speed_mps=scaled(fields.get("kd"), KMH_MPS),
    )


SENDER = Sender("torque", "Torque", read, "OK!")
