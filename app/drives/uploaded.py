"""What came of an upload: a drive, or several where its files are several, and the files that are none's.

Row and job of each drive are made by themselves (``intake``), so that one that is refused keeps none of the others.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel, Field

from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.errors import QuotaError
from app.core.http import Link
from app.core.messages import SAID, Said
from app.drives import intake
from app.drives.documents import DRIVE_EXAMPLE, Drive, DriveAccepted, DriveStatus, drive_links
from app.drives.receiving.sorting import Doubt, LeftOut, Sorted, Stored
from fusion.messages import message_of

_FILES = ["monday.fit", "tuesday.fit", "readme.txt"]
_NO_LOG = "The file is in no format that is known here."
_DRIVE = {"id": DRIVE_EXAMPLE["id"], "status": "queued", "files": _FILES[:1], "known": False, "unclear": []}
_EXAMPLE: dict[str, Any] = {
    "id": DRIVE_EXAMPLE["id"],
    "status": "queued",
    "links": DRIVE_EXAMPLE["links"],
    "drives": [
        {**_DRIVE, "links": DRIVE_EXAMPLE["links"]},
        {**_DRIVE, "id": "7a1f1c0e-9b7e-4c43-9d64-1e2f35c0a1b2", "files": _FILES[1:2], "links": []},
    ],
    "left_out": [{"file": _FILES[2], "kind": "unknown-format", "reason": _NO_LOG}],
}


class UnclearFiles(BaseModel):
    """Files that were taken for one drive and could be several."""

    files: list[str]
    why: str = Field(
        description="`continues`: each goes on where the one before ended, at most five minutes later; `overlaps`: "
        "they have positions of the same time."
    )


class UploadedDrive(BaseModel):
    """One drive of an upload."""

    id: uuid.UUID
    status: DriveStatus
    files: list[str] = Field(description="The files that it is made of.")
    known: bool = Field(description="Whether the owner had it already.")
    unclear: list[UnclearFiles] = Field(
        description="Where it is not sure that they are one drive. `grouping=apart` makes several of them."
    )
    links: list[Link]


class LeftOutFile(BaseModel):
    """A file that is in no drive; of an upload that is one drive, a file that adds nothing to it."""

    file: str
    kind: str = Field(
        description="Stable identifier of the reason: that of a log that is refused, `repeated` for what holds the "
        "same as another file, `no-drive` for what belongs to none of the others, `quota`."
    )
    reason: str
    said: Said | None = Field(None, description=f"The reason by its key; {SAID}")


class UploadAccepted(DriveAccepted, json_schema_extra={"examples": [_EXAMPLE]}):
    """The answer to an upload: its first drive, all of them, and the files that came to nothing."""

    drives: list[UploadedDrive] = Field(description="The drives in the order of the files.")
    left_out: list[LeftOutFile]


@dataclass(frozen=True)
class Taken:
    """A drive that came of files, and whether it is new."""

    files: Stored
    drive: Drive
    created: bool


@dataclass(frozen=True)
class Uploaded:
    """The drives of an upload, at least one, and the files that are none's."""

    drives: tuple[Taken, ...]
    left_out: tuple[LeftOut, ...]

    @property
    def any_created(self) -> bool:
        """Whether one of them is new."""
        return any(one.created for one in self.drives)

    def document(self, base: str) -> UploadAccepted:
        """As it is answered."""
        drives = [
            UploadedDrive(
                id=one.drive.id,
                status=one.drive.status,
                files=list(one.files.files),
                known=not one.created,
                unclear=[_unclear(doubt) for doubt in one.files.doubts],
                links=drive_links(base, one.drive),
            )
            for one in self.drives
        ]
        first, left_out = drives[0], [_left_out(one) for one in self.left_out]
        return UploadAccepted(
            id=first.id, status=first.status, links=first.links, drives=drives, left_out=left_out
        )


def _left_out(one: LeftOut) -> LeftOutFile:
    return LeftOutFile(**one._asdict(), said=Said.of(one.reason))


def _unclear(doubt: Doubt) -> UnclearFiles:
    return UnclearFiles(files=list(doubt.files), why=doubt.why)


def register_drives(
    sessions: Sessions,
    blobs: BlobStore,
    files: Sorted,
    *,
    method: str,
    options: Mapping[str, Any],
    count: intake.Count,
    refused: Callable[[QuotaError], object],
) -> Uploaded:
    """Make queued drives of what an upload holds, by ``intake.register_upload``, and raise what that does.

    What no quota has room for is left out, and ``refused`` is told; ``QuotaError`` where that is everything. What was
    registered before an error stays: the same upload again finds it.
    """
    taken, left_out, errors = list[Taken](), list(files.left_out), list[QuotaError]()
    for number, one in enumerate(files.drives):
        try:
            drive, created = intake.register_upload(
                sessions, blobs, one.blob, filename=one.name, method=method, options=options, count=count
            )
            taken.append(Taken(one, drive, created))
        except QuotaError as error:
            errors.append(error)
            refused(error)
            left_out += [LeftOut(name, "quota", message_of(error)) for name in one.files]
        except BaseException:
            for other in files.drives[number + 1 :]:
                blobs.delete(other.blob.key)
            raise
    if not taken:
        raise errors[0]
    return Uploaded(tuple(taken), tuple(left_out))
