"""A drive's track as one compressed Arrow stream: a row per epoch, columns as in ``fusion.types.Track``."""

from __future__ import annotations

import uuid
from dataclasses import fields

import numpy as np
import pyarrow as pa
from sqlalchemy import select
from sqlalchemy.dialects.postgresql import insert
from sqlalchemy.orm import Session

from app.models import DriveTrack
from app.store.rows import StoredTrack
from fusion.types import Ints, Track


def save_track(session: Session, drive_id: uuid.UUID, track: Track, segment_ids: Ints) -> None:
    """Store the track; ``segment_ids`` maps its ``segment`` (index into the run's network) to stored ids."""
    row = insert(DriveTrack).values(drive_id=drive_id, track=encode(track, segment_ids))
    session.execute(
        row.on_conflict_do_update(index_elements=["drive_id"], set_={"track": row.excluded.track})
    )


def read_track(session: Session, drive_id: uuid.UUID) -> StoredTrack | None:
    """The track of a drive's last successful run, or None."""
    data = session.execute(select(DriveTrack.track).where(DriveTrack.drive_id == drive_id)).scalar()
    return None if data is None else decode(data)


def encode(track: Track, segment_ids: Ints) -> bytes:
    """The track as an Arrow IPC stream; ``segment`` becomes database ids, -1 where unmatched."""
    columns = {spec.name: getattr(track, spec.name) for spec in fields(track)}
    columns["segment"] = np.full(len(track), -1, np.int64)
    matched = track.segment >= 0
    columns["segment"][matched] = segment_ids[track.segment[matched]]
    batch = pa.record_batch([pa.array(column) for column in columns.values()], names=list(columns))
    sink = pa.BufferOutputStream()
    options = pa.ipc.IpcWriteOptions(compression="zstd")
    with pa.ipc.new_stream(sink, batch.schema, options=options) as writer:
        writer.write_batch(batch)
    return bytes(sink.getvalue().to_pybytes())


def decode(data: bytes) -> StoredTrack:
    """The inverse of ``encode``, bit for bit."""
    table = pa.ipc.open_stream(data).read_all()
    columns = {spec.name: table.column(spec.name).to_numpy().copy() for spec in fields(Track)}
    return StoredTrack(track=Track(**columns), segment_id=columns["segment"])
