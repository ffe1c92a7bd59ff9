"""Everything that an owner has, as one ZIP that is written while it is read.

Drive after drive: each is read in one short transaction, and while the client takes what came of it nobody's
connection is held. All archives of a process share one. Reading is done as the owner itself, so that row level security
keeps what is others' out, whoever asked.
"""

from __future__ import annotations

import hashlib
import json
import uuid
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from threading import Lock
from typing import Any, BinaryIO, TypeVar

from sqlalchemy.orm import Session

from app.access import store as access
from app.access.documents import Key, OwnerFigures
from app.access.quotas import standing, utc_now
from app.access.zone_store import zones_of
from app.access.zones import Zones
from app.changes.webhooks import store as webhooks
from app.changes.webhooks.routes import Webhook
from app.core.caller import Caller, as_caller, present_caller
from app.core.http import Service
from app.core.telemetry import audit
from app.core.text import collection_chunks, utc_text
from app.core.version import code_version
from app.drives import store as drives
from app.drives import tracks
from app.drives.documents import Drive, DrivePlace, linked
from app.drives.live import store as live
from app.drives.live.cutting import MOST_POINTS, filename_of, log_of
from app.drives.live.documents import Stream
from app.drives.outputs.estimates import estimate_feature
from app.drives.outputs.profile import Profile
from app.drives.outputs.track import track_chunks
from app.drives.parts.reading import (
    drive_profile,
    in_blocks,
    log_name,
    measurements_text,
    plain_name,
    profile_text,
)
from app.map.segment import attribution
from app.map.store import DriveSegmentRow, drive_segment_rows
from fusion.types import DrawnMeasurements, Track

T = TypeVar("T")

AT_ONCE = 2
"""Archives that a process sends, and as many for clients that have none."""
_PAGE = 100
_ONE_READS = Lock()
"""So that archives take one connection together, and the rest are left to requests that somebody waits for."""


@dataclass
class _Index:
    """What the archive says of itself: how much there is, and what is not there that should be."""

    owner_id: int
    drives: int = 0
    logs: int = 0
    logs_deleted: int = 0
    audit_rows: int = 0
    problems: list[dict[str, str]] = field(default_factory=list)

    def miss(self, drive: Drive, file: str, reason: str) -> None:
        self.problems.append({"drive_id": str(drive.id), "file": file, "problem": reason})


@dataclass(frozen=True)
class _Parts:
    """A drive with what its last run yielded; None: nothing yet."""

    drive: Drive
    track: Track | None
    profile: Profile | None
    measurements: DrawnMeasurements | None
    segments: list[DriveSegmentRow]


class Archive:
    """The archive of one owner."""

    def __init__(self, service: Service, base: str, owner_id: int) -> None:
        """``base``: the address that links of documents begin with."""
        self._service, self._base, self._index = service, base, _Index(owner_id)
        self._owner = Caller("own", owner_id, sees=present_caller().sees)
        self._began = datetime.now(UTC)
        self._zip = ZipStream(self._began)

    def pieces(self) -> Iterator[bytes]:
        """The bytes of the archive."""
        yield from self._of_owner()
        yield from self._under_way()
        for drive in self._drives():
            parts = self._read(_parts_of, drive.id)
            if parts is not None:
                yield from self._of_drive(parts)
        yield from self._text("audit.json", self._audit())
        yield from self._text("index.json", iter([self._index_document()]))
        yield self._zip.end()

    def _read(self, read: Callable[..., T], *arguments: Any, **named: Any) -> T:
        """One short transaction as the owner's."""
        with _ONE_READS, as_caller(self._owner), self._service.sessions() as session:
            return read(session, *arguments, **named)

    def _of_owner(self) -> Iterator[bytes]:
        for name, document in self._read(self._owner_documents).items():
            yield from self._text(name, iter([_pretty(document)]))

    def _owner_documents(self, session: Session) -> dict[str, Any]:
        owner_id, settings = self._index.owner_id, self._service.settings
        owner = access.get_owner(session, owner_id)
        assert owner is not None  # noqa: S101 - the route has seen it
        now = standing(session, settings, owner_id, utc_now())
        figures = OwnerFigures.standing(owner, now, settings.keep_logs_days)
        keys = [Key.of(key).model_dump(mode="json") for key in access.list_keys(session)]
        called = [
            Webhook.of(row, self._base).model_dump(mode="json") for row in webhooks.list_webhooks(session)
        ]
        seen = live.streams(session, live.MOST_STREAMS)
        devices = [Stream.of(one).model_dump(mode="json") for one in seen]
        return {
            "owner.json": figures.model_dump(mode="json"),
            "keys.json": {"keys": keys},
            "zones.geojson": Zones.of(zones_of(session, owner_id)).model_dump(mode="json"),
            "webhooks.json": {"webhooks": called},
            "devices.json": {"streams": devices},
        }

    def _under_way(self) -> Iterator[bytes]:
        """Points of devices that are in no log yet."""
        for stream in self._read(live.streams, live.MOST_STREAMS):
            points = self._read(live.points_of, stream.id, 2 * MOST_POINTS)
            if points:
                name = filename_of(stream.sender, stream.device, points)
                yield from self._text(f"under-way/{stream.id}-{name}", iter([log_of(points).decode()]))

    def _drives(self) -> Iterator[Drive]:
        """All that are shown, the newest first; those that come meanwhile are not among them."""
        place: DrivePlace | None = None
        while True:
            page = self._read(drives.list_drives, limit=_PAGE, after=place)
            yield from page
            if len(page) < _PAGE:
                return
            place = DrivePlace(page[-1].created_at, page[-1].id, page[-1].list_key)

    def _of_drive(self, parts: _Parts) -> Iterator[bytes]:
        drive, index = parts.drive, self._index
        folder = f"drives/{drive.created_at.astimezone(UTC):%Y-%m-%d}-{drive.id}"
        index.drives += 1
        with as_caller(self._owner):
            document = _pretty(linked(self._base, drive).model_dump(mode="json"))
        yield from self._text(f"{folder}/drive.json", iter([document]))
        yield from self._log(drive, folder)
        if parts.track is None or parts.profile is None:
            return
        ids = {"drive_id": str(drive.id)}
        yield from self._text(f"{folder}/track.geojson", track_chunks(parts.track, parts.track.segment))
        members = {"attribution": attribution()}
        segments = collection_chunks(map(estimate_feature, parts.segments), members)
        yield from self._text(f"{folder}/segments.geojson", segments)
        yield from self._zip.add(f"{folder}/profile.json", iter([profile_text(ids, parts.profile)]))
        said = measurements_text(ids, parts.profile, parts.measurements)
        yield from self._zip.add(f"{folder}/measurements.json", iter([said]))

    def _log(self, drive: Drive, folder: str) -> Iterator[bytes]:
        """The log as it came. What is wrong with it is said in the index: the rest is to be had all the same."""
        index = self._index
        if drive.log_deleted_at is not None:
            index.logs_deleted += 1
            return
        try:
            file = self._service.blobs.open(drive.blob_key, PIECE_BYTES)
            path = f"{folder}/log/{plain_name(log_name(drive.filename, file))}"
        except OSError as error:
            index.miss(drive, "log", f"The log cannot be read: {type(error).__name__}.")
            return
        with file:
            index.logs += 1
            digest = hashlib.sha256()
            yield from self._zip.add(path, self._chunks(drive, path, file, digest), drive.size_bytes)
        if digest.hexdigest() != drive.sha256:
            index.miss(drive, path, "The log is damaged: its SHA-256 is not that of what was uploaded.")

    def _chunks(self, drive: Drive, path: str, file: BinaryIO, digest: Any) -> Iterator[bytes]:
        left = drive.size_bytes  # what is damaged may be longer than the ZIP's header says
        try:
            while left > 0 and (chunk := file.read(min(PIECE_BYTES, left))):
                digest.update(chunk)
                left -= len(chunk)
                yield chunk
        except OSError as error:
            self._index.miss(drive, path, f"The log ends where it could not be read: {type(error).__name__}.")

    def _audit(self) -> Iterator[str]:
        """Rows of the audit, as a JSON list that is written as it is read."""
        after, separator = 0, "[\n"
        while True:
            rows = self._read(audit.entries_of, self._index.owner_id, after)
            for row in rows:
                after = row.pop("id")
                self._index.audit_rows += 1
                yield separator + json.dumps(
                    {**row, "at": utc_text(row["at"]), "key": row["key"] and str(row["key"])}
                )
                separator = ",\n"
            if not rows:
                yield "[]\n" if separator == "[\n" else "\n]\n"
                return

    def _index_document(self) -> str:
        index = self._index
        return _pretty(
            {
                "made_at": utc_text(self._began),
                "made_by": f"Versant {code_version()}",
                "drives": index.drives,
                "logs": index.logs,
                "logs_deleted": index.logs_deleted,
                "audit_rows": index.audit_rows,
                "problems": index.problems,
                "complete": not index.problems,
            }
        )

    def _text(self, name: str, chunks: Iterator[str]) -> Iterator[bytes]:
        return self._zip.add(name, (block.encode() for block in in_blocks(chunks)))


def _parts_of(session: Session, drive_id: uuid.UUID) -> _Parts | None:
    drive = drives.get_drive(session, drive_id)
    if drive is None:  # removed meanwhile
        return None
    track = tracks.read_track(session, drive.id)
    if track is None:
        return _Parts(drive, None, None, None, [])
    profile = drive_profile(session, drive.id, track)
    segments = drive_segment_rows(session, drive.id)
    return _Parts(drive, track, profile, tracks.read_measurements(session, drive.id), segments)


def _pretty(document: Any) -> str:
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


PIECE_BYTES = 256 * 1024
_OWNERS_ALONE = 0o600 << 16


class ZipStream:
    """An archive on its way out, neither on disk nor in memory: ``add`` and ``end`` give its bytes.

    Sizes and checksums follow each file (a "data descriptor"), since nothing is known of it before it has been read.
    What memory holds is a piece, and half a kilobyte of each file: a ZIP ends with the list of all.
    """

    def __init__(self, moment: datetime) -> None:
        """``moment``: the time of all files."""
        self._sink = _Sink()
        self._zip = zipfile.ZipFile(self._sink, "w")
        self._time = moment.astimezone(UTC).timetuple()[:6]

    def add(self, name: str, chunks: Iterable[bytes], size_bytes: int | None = None) -> Iterator[bytes]:
        """A file. One whose size is known is stored as it is: logs come compressed, or are to be had byte for byte."""
        info = zipfile.ZipInfo(name, self._time)
        info.external_attr = _OWNERS_ALONE
        info.compress_type = zipfile.ZIP_DEFLATED if size_bytes is None else zipfile.ZIP_STORED
        info.file_size = size_bytes or 0  # from 4 GiB on the format is another one
        with self._zip.open(info, "w") as file:
            for chunk in chunks:
                file.write(chunk)
                if self._sink.size_bytes >= PIECE_BYTES:
                    yield self._sink.take()

    def end(self) -> bytes:
        """What is left, and the list of all files."""
        self._zip.close()
        return self._sink.take()


class _Sink:
    """What the archive is written to. It has no positions, by which ``zipfile`` knows that it cannot go back."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self.size_bytes = 0

    def write(self, piece: bytes) -> int:
        self._pieces.append(bytes(piece))
        self.size_bytes += len(piece)
        return len(piece)

    def flush(self) -> None:
        """Nothing waits."""

    def close(self) -> None:
        """Nothing is open."""

    def take(self) -> bytes:
        taken = b"".join(self._pieces)
        self._pieces, self.size_bytes = [], 0
        return taken
