"""A drive's track and what its sensors said, kept as Arrow IPC streams, and the picture that was drawn of them."""

from __future__ import annotations

import json
import uuid
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, NamedTuple, Self

import numpy as np
import pyarrow as pa
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.caller import seeing_all
from app.core.tables import IS_SHOWN
from app.drives.documents import Drive
from fusion.types import DrawnMeasurements, Ints, Track

_SENSORS = b"sensors"
"""Metadata: a JSON list of the sensors, [name, is_height] each; ``sensor`` is an index into it."""

# A drive that is processed again has one track still: that of its last run.
_SAVE = text("""
    INSERT INTO drive_tracks (drive_id, track, measurements) VALUES (:drive_id, :track, :measurements)
    ON CONFLICT (drive_id) DO UPDATE SET track = excluded.track, measurements = excluded.measurements
""")
_TRACK = text("SELECT track FROM drive_tracks WHERE drive_id = :drive_id")
_MEASUREMENTS = text("SELECT measurements FROM drive_tracks WHERE drive_id = :drive_id")

PICTURE_SCHEMA = 1
"""Raise it whenever a picture changes without its drive changing."""

_PICTURE = text("SELECT png FROM drive_pictures WHERE drive_id = :drive_id AND drawn_of = :drawn_of")

# Of a drive that was removed while its picture was drawn nothing is kept: a removal that is under way is waited for.
_KEEP_PICTURE = text(
    f"""
    INSERT INTO drive_pictures (drive_id, drawn_of, png)
    SELECT d.id, :drawn_of, :png FROM drives AS d WHERE d.id = :drive_id AND {IS_SHOWN.format("d")} FOR KEY SHARE
    ON CONFLICT (drive_id) DO UPDATE
        SET drawn_of = excluded.drawn_of, png = excluded.png, drawn_at = excluded.drawn_at
    """  # noqa: S608 - constants
)
_DROP_OLD_PICTURES = text("""
    DELETE FROM drive_pictures WHERE drive_id IN
        (SELECT drive_id FROM drive_pictures ORDER BY drawn_at DESC OFFSET :kept)
""")


_COLUMN_NAMES = {"after_outage": "starts"}
"""Fields of ``Track`` that stored tracks know by another name."""


class EncodedTrack(NamedTuple):
    """A track, and what the sensors said (None: nothing), as they are stored."""

    track: bytes
    measurements: bytes | None

    @classmethod
    def of(cls, track: Track, segment_ids: Ints, measurements: DrawnMeasurements | None = None) -> Self:
        """``segment_ids`` maps the track's ``segment`` (index into the run's network) to stored ids."""
        said = None if measurements is None else encode_measurements(measurements)
        return cls(encode(track, segment_ids), said)


def save_track(session: Session, drive_id: uuid.UUID, encoded: EncodedTrack) -> None:
    """Store the track of a drive in place of what it has."""
    session.execute(_SAVE, {"drive_id": drive_id, **encoded._asdict()})


def read_track(session: Session, drive_id: uuid.UUID) -> Track | None:
    """The track of a drive's last successful run (as ``decode`` has it), or None."""
    data = session.execute(_TRACK, {"drive_id": drive_id}).scalar()
    return None if data is None else decode(data)


def read_measurements(session: Session, drive_id: uuid.UUID) -> DrawnMeasurements | None:
    """What the sensors said in a drive's last successful run; None where its method offers none."""
    data = session.execute(_MEASUREMENTS, {"drive_id": drive_id}).scalar()
    return None if data is None else decode_measurements(data)


def run_shown(drive: Drive) -> str | None:
    """Names what a picture of the drive shows; None while it waits or runs, when another result may come any time."""
    if drive.status != "done" or drive.finished_at is None:
        return None
    return f"{PICTURE_SCHEMA}.{drive.generation}.{drive.method}.{drive.finished_at.isoformat()}"


def read_picture(session: Session, drive: Drive) -> bytes | None:
    """The picture that was drawn of the drive as it is now, or None."""
    values = {"drive_id": drive.id, "drawn_of": run_shown(drive)}
    data = session.execute(_PICTURE, values).scalar()
    return None if data is None else bytes(data)


def keep_picture(session: Session, drive: Drive, png: bytes, kept: int) -> None:
    """Keep the drive's picture among the last ``kept`` that were drawn of any drives."""
    if run_shown(drive) is not None:
        session.execute(_KEEP_PICTURE, {"drive_id": drive.id, "drawn_of": run_shown(drive), "png": png})
        with seeing_all(session):
            session.execute(_DROP_OLD_PICTURES, {"kept": kept})


def encode(track: Track, segment_ids: Ints) -> bytes:
    """The track as an Arrow IPC stream; ``segment`` becomes database ids, -1 where unmatched."""
    columns = {_COLUMN_NAMES.get(spec.name, spec.name): getattr(track, spec.name) for spec in fields(track)}
    columns["segment"] = np.full(len(track), -1, np.int64)
    matched = track.segment >= 0
    columns["segment"][matched] = segment_ids[track.segment[matched]]
    return stream(columns)


def decode(data: bytes) -> Track:
    """The inverse of ``encode``, bit for bit.

    ``segment`` is the database's id of the matched segment, -1 where unmatched. A segment that a later road import
    dropped keeps its id here.
    """
    table = pa.ipc.open_stream(data).read_all()
    names = [(spec.name, _COLUMN_NAMES.get(spec.name, spec.name)) for spec in fields(Track)]
    columns = {name: table.column(stored).to_numpy().copy() for name, stored in names}
    return Track(**columns)


def encode_measurements(measurements: DrawnMeasurements) -> bytes:
    """The measurements as an Arrow IPC stream; values and distances in single precision, enough to draw."""
    heights = {int(s) for s in np.unique(measurements.sensor[measurements.is_height])}
    sensors = [[name, code in heights] for code, name in enumerate(measurements.names)]
    columns = {
        "sensor": measurements.sensor.astype(np.int8),
        "time_s": measurements.time_s.astype(np.float64),
        "value": measurements.value.astype(np.float32),
        "along_m": measurements.along_m.astype(np.float32),
    }
    return stream(columns, {_SENSORS: json.dumps(sensors).encode()})


def decode_measurements(data: bytes) -> DrawnMeasurements:
    """The inverse of ``encode_measurements``, up to single precision."""
    table = pa.ipc.open_stream(data).read_all()
    sensors = json.loads(table.schema.metadata[_SENSORS])
    sensor = table.column("sensor").to_numpy().astype(np.int64)
    return DrawnMeasurements(
        names=tuple(name for name, _ in sensors),
        sensor=sensor,
        time_s=table.column("time_s").to_numpy().copy(),
        along_m=table.column("along_m").to_numpy().astype(np.float64),
        value=table.column("value").to_numpy().astype(np.float64),
        is_height=np.array([is_height for _, is_height in sensors], bool)[sensor],
    )


def stream(columns: Mapping[str, Any], metadata: Mapping[bytes, bytes] | None = None) -> bytes:
    """One record batch of these columns as a stream, compressed by zstd."""
    batch = pa.record_batch([pa.array(column) for column in columns.values()], names=list(columns))
    batch = batch.replace_schema_metadata(metadata)
    sink = pa.BufferOutputStream()
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(sink, batch.schema, options=options) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())
