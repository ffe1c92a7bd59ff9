"""What a receiver says of its own sensors: ESF-STATUS, one record per sensor and navigation epoch.

Faults gate readings: a sensor whose measurements or time tags the receiver found bad, or too noisy, is not used
there. The calibration does not: it belongs to the receiver's own fusion (ESF-INS, HNR-INS and NAV-ATT gain by it),
while ESF-MEAS and ESF-RAW are raw before it and after, and the thesis's "calibration" (annex B.4.1) is the turn of
two axes. An attitude that the receiver has not found yet says so itself, by an accuracy of 0.

Source: u-blox 8 / M8 receiver description, "ESF-STATUS".
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fusion.formats.base import Bools, Data, Notes
from fusion.formats.ubx_frame import Frames
from fusion.formats.ubx_messages import ESF_STATUS, gather
from fusion.types import Ints

_HEAD_BYTES = 16
_BAD_MEASUREMENTS, _BAD_TIME_TAGS, _NOISY = 0x1, 0x2, 0x8
_FAULTS = _BAD_MEASUREMENTS | _BAD_TIME_TAGS | _NOISY
_CALIBRATED = 2
"""Least calibration status of a calibrated sensor: 0 not yet, 1 in progress, 2 and 3 done."""


@dataclass(frozen=True)
class SensorStatus:
    """One row per sensor and message in stream order; all (n,). ``offset`` is the message's first byte."""

    offset: Ints
    data_type: Ints
    calibration: Ints
    faulty: Bools

    def spoils(self, data_type: Ints, offset: Ints) -> Bools:
        """Which readings, by their types and byte offsets, the next status of their sensor calls faulty."""
        spoilt = np.zeros(len(offset), np.bool_)
        for number in np.unique(self.data_type[self.faulty]):
            mine, asked = np.flatnonzero(self.data_type == number), np.flatnonzero(data_type == number)
            following = np.searchsorted(self.offset[mine], offset[asked])
            told = following < len(mine)
            spoilt[asked[told]] = self.faulty[mine[following[told]]]
        return spoilt

    def tell(self, data_types: tuple[int, ...], sensor: str, notes: Notes) -> None:
        """Say how long a sensor was not calibrated, if it was not throughout."""
        mine = np.isin(self.data_type, data_types)
        messages, first = np.unique(self.offset[mine], return_index=True)
        if not len(messages):
            return
        worst = np.minimum.reduceat(self.calibration[mine], first)
        count = int(np.count_nonzero(worst < _CALIBRATED))
        if count:
            notes.warn(
                f"The receiver had not calibrated its {sensor} in {count} of {len(messages)} status messages "
                "(ESF-STATUS): its readings are used, being raw either way, but its attitude may be off there."
            )


def read_status(data: Data, frames: Frames) -> SensorStatus:
    """The records of all ESF-STATUS messages."""
    parts = [np.empty((0, 5), np.int64)]
    mine = frames.kind == ESF_STATUS
    for length in np.unique(frames.length[mine & (frames.length >= _HEAD_BYTES + 4)]):
        start = frames.start[mine & (frames.length == length)]
        room = (int(length) - _HEAD_BYTES) // 4
        records = gather(
            data,
            start + 6,
            np.dtype([("head", "V15"), ("sensors", "u1"), ("sensor", "u1", (room, 4))]),
        )
        listed = np.arange(room) < records["sensors"][:, None]
        at = np.broadcast_to(start[:, None], listed.shape)[listed]
        parts.append(np.column_stack([at, records["sensor"][listed].astype(np.int64)]))
    rows = np.concatenate(parts)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return SensorStatus(rows[:, 0], rows[:, 1] & 0x3F, rows[:, 2] & 0x3, rows[:, 4] & _FAULTS != 0)
