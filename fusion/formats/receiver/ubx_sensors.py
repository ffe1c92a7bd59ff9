"""Sensor messages of UBX receivers: ESF-MEAS and ESF-RAW to specific force, angular rate and speed; ESF-STATUS.

Axes are the receiver's as printed on it: x forward, y left, z up on the thesis's car (annex B.4), which is the body
frame of ``fusion.types``; a receiver mounted otherwise is levelled by the methods, not here. ESF-STATUS says which
sensors were at fault: their readings are left out up to that message. Knows no calendar: times come as marks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from fusion.arrays import ColumnTable
from fusion.formats.base import Data, Notes
from fusion.formats.receiver import ubx_messages
from fusion.formats.receiver.time_tags import MEAS_HZ, RAW_HZ, Marks, align
from fusion.formats.receiver.ubx_frames import Frames
from fusion.formats.receiver.ubx_messages import Records, gather
from fusion.messages import say
from fusion.types import AngularRate, Bools, Floats, Ints, Odometry, SensorTable, SpecificForce

FORCE = ("acc_x_mps2", "acc_y_mps2", "acc_z_mps2")
RATE = ("gyr_x_radps", "gyr_y_radps", "gyr_z_radps")
_RECEIVER_TAG = 0x8
"""ESF-MEAS flag: a receiver time tag follows the data words."""
_HEAD_BYTES = 16
_BAD_MEASUREMENTS, _BAD_TIME_TAGS, _NOISY = 0x1, 0x2, 0x8
_FAULTS = _BAD_MEASUREMENTS | _BAD_TIME_TAGS | _NOISY
_CALIBRATED = 2
"""Least calibration status of a calibrated sensor: 0 not yet, 1 in progress, 2 and 3 done."""


@dataclass(frozen=True)
class Samples(ColumnTable):
    """Data words of one counter in stream order; all (n,). ``offset`` is the message's first byte."""

    tick: Ints
    word: Ints
    data_type: Ints
    offset: Ints


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
            mine, theirs = np.flatnonzero(self.data_type == number), np.flatnonzero(data_type == number)
            following = np.searchsorted(self.offset[mine], offset[theirs])
            has_next = following < len(mine)
            spoilt[theirs[has_next]] = self.faulty[mine[following[has_next]]]
        return spoilt

    def warn_uncalibrated(self, data_types: tuple[int, ...], sensor: str, notes: Notes) -> None:
        """Warn of the status messages in which a sensor was not calibrated."""
        mine = np.isin(self.data_type, data_types)
        messages, first = np.unique(self.offset[mine], return_index=True)
        if not len(messages):
            return
        worst = np.minimum.reduceat(self.calibration[mine], first)
        count = int(np.count_nonzero(worst < _CALIBRATED))
        if count:
            notes.warn(say("receiver.not_calibrated", sensor=sensor, n=count, messages=len(messages)))


Timed = tuple[Samples, Floats]
Table = TypeVar("Table", bound=SensorTable)
_TYPE_OF = {column: data_type for data_type, (column, _) in ubx_messages.ESF_DATA.items()}


def sensor_tables(
    data: Data, frames: Frames, marks: Marks, notes: Notes
) -> tuple[SpecificForce, AngularRate, Odometry]:
    """Tables from both kinds of message.

    A receiver that writes both sends the means of its raw samples as measurements: where these cover the
    drive, they are used alone, so that no reading counts twice.
    """
    status = read_status(data, frames)
    status.warn_uncalibrated((16, 17, 18), "accelerometer", notes)
    status.warn_uncalibrated((14, 13, 5), "gyroscope", notes)
    measured = [_sound(samples, status, notes) for samples in measurements(data, frames)]
    rough = _sound(raw_samples(data, frames), status, notes)
    means = [(s, align(s.tick, s.offset, marks, MEAS_HZ, notes.skipped)) for s in measured]
    raws = [(rough, align(rough.tick, rough.offset, marks, RAW_HZ, notes.skipped))]
    ticks = sum(int(np.isin(s.data_type, ubx_messages.WHEEL_TICKS).sum()) for s, _ in means)
    notes.skip("wheel ticks (their number per turn is not known)", ticks)
    if len(rough.tick) + len(measured) and not len(marks.time_s):
        notes.warn(say("receiver.sensors_undated"))
    return (
        _better(SpecificForce, FORCE, means, raws),
        _better(AngularRate, RATE, means, raws),
        _tabulate(Odometry, ("speed_mps",), means),
    )


def _sound(samples: Samples, status: SensorStatus, notes: Notes) -> Samples:
    """The samples of which the receiver does not say that their sensor was at fault."""
    spoilt = status.spoils(samples.data_type, samples.offset)
    notes.skip("sensor readings that the receiver marks as faulty", int(spoilt.sum()))
    return samples.take(~spoilt)


def _better(table: type[Table], names: tuple[str, ...], means: list[Timed], raws: list[Timed]) -> Table:
    mean, rough = _tabulate(table, names, means), _tabulate(table, names, raws)
    return rough if _span_s(rough) > 1.2 * _span_s(mean) + 2 else mean if len(mean) else rough


def _span_s(table: SensorTable) -> float:
    return float(np.ptp(table.time_s)) if len(table) else -np.inf


def _tabulate(table: type[Table], names: tuple[str, ...], sources: list[Timed]) -> Table:
    """One row per distinct time: the axes of one instant come in separate words."""
    types = [_TYPE_OF[name] for name in names]
    used = [np.isin(s.data_type, types) & np.isfinite(t) for s, t in sources]
    if not any(u.any() for u in used):
        return table.empty()
    time_s = np.concatenate([t[u] for (_, t), u in zip(sources, used, strict=True)])
    data_type = np.concatenate([s.data_type[u] for (s, _), u in zip(sources, used, strict=True)])
    word = np.concatenate([s.word[u] for (s, _), u in zip(sources, used, strict=True)])
    instants, row = np.unique(time_s, return_inverse=True)
    columns = {}
    for name, number in zip(names, types, strict=True):
        columns[name] = np.full(len(instants), np.nan)
        mine = data_type == number
        columns[name][row[mine]] = ubx_messages.signed_24(word[mine]) * ubx_messages.ESF_DATA[number][1]
    return table.assemble(instants, None, **columns)


def _records(
    data: Data, frames: Frames, kind: int, least_bytes: int, type_of: Callable[[int], list[Any]]
) -> Iterator[tuple[Ints, Records]]:
    """The messages of a kind by their length, from which their type follows: their offsets, and what they hold."""
    mine = (frames.kind == kind) & (frames.length >= least_bytes)
    for length in np.unique(frames.length[mine]):
        start = frames.start[mine & (frames.length == length)]
        yield start, gather(data, start + 6, np.dtype(type_of(int(length))))


def measurements(data: Data, frames: Frames) -> list[Samples]:
    """The words of all ESF-MEAS messages, one ``Samples`` per sensor id: each has its own counter."""

    def type_of(length: int) -> list[Any]:
        return [("tag", "<u4"), ("flags", "<u2"), ("id", "<u2"), ("word", "<u4", ((length - 8) // 4,))]

    parts, ids = [], []
    for start, records in _records(data, frames, ubx_messages.ESF_MEAS, 12, type_of):
        words = records["word"].shape[1]
        keep = np.arange(words) < (words - ((records["flags"] & _RECEIVER_TAG) != 0))[:, None]
        flat = keep.ravel()
        word = records["word"].astype(np.int64)[keep]
        tick = np.repeat(records["tag"].astype(np.int64), words)[flat]
        parts.append(Samples(tick, word & 0xFFFFFF, word >> 24 & 0x3F, np.repeat(start, words)[flat]))
        ids.append(np.repeat(records["id"].astype(np.int64), words)[flat])
    if not parts:
        return []
    samples, sensor = parts[0].joined(*parts[1:]), np.concatenate(ids)
    order = np.lexsort((samples.offset, sensor))
    edges = np.flatnonzero(np.diff(sensor[order])) + 1
    return [samples.take(piece) for piece in np.split(order, edges) if len(piece)]


def raw_samples(data: Data, frames: Frames) -> Samples:
    """The words of all ESF-RAW messages."""

    def type_of(length: int) -> list[Any]:
        return [("reserved", "V4"), ("block", [("word", "<u4"), ("tag", "<u4")], ((length - 4) // 8,))]

    parts = [Samples(*[np.empty(0, np.int64)] * 4)]
    for start, records in _records(data, frames, ubx_messages.ESF_RAW, 12, type_of):
        block = records["block"]
        word, tick = (block[name].ravel().astype(np.int64) for name in ("word", "tag"))
        parts.append(Samples(tick, word & 0xFFFFFF, word >> 24, np.repeat(start, block.shape[1])))
    samples = parts[0].joined(*parts[1:])
    return samples.take(np.argsort(samples.offset, kind="stable"))


def read_status(data: Data, frames: Frames) -> SensorStatus:
    """The records of all ESF-STATUS messages."""

    def type_of(length: int) -> list[Any]:
        return [("head", "V15"), ("sensors", "u1"), ("sensor", "u1", ((length - _HEAD_BYTES) // 4, 4))]

    parts = [np.empty((0, 5), np.int64)]
    for start, records in _records(data, frames, ubx_messages.ESF_STATUS, _HEAD_BYTES + 4, type_of):
        listed = np.arange(records["sensor"].shape[1]) < records["sensors"][:, None]
        at = np.broadcast_to(start[:, None], listed.shape)[listed]
        parts.append(np.column_stack([at, records["sensor"][listed].astype(np.int64)]))
    rows = np.concatenate(parts)
    rows = rows[np.argsort(rows[:, 0], kind="stable")]
    return SensorStatus(rows[:, 0], rows[:, 1] & 0x3F, rows[:, 2] & 0x3, rows[:, 4] & _FAULTS != 0)
