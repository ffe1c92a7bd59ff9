"""The logs of a batch into a service's store, as uploads are."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from app.batch.archive import Input
from app.batch.errors import BatchError
from app.batch.opened import digest, opened
from app.core.blobs import LOGS, StoredBlob
from app.core.filesystems import file_system
from app.core.messages import say
from app.core.receiving.body import Piece
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.upload_bundle import COPY_BYTES, UploadBundle
from app.jobs.context import JobContext


def not_reached(inputs: Sequence[Input], progress: Callable[[int], None]) -> list[Input]:
    """Those whose files are not there; each file is looked for once. ``progress`` takes how many more were seen to."""
    there: dict[str, bool] = {}
    missing = []
    for one in inputs:
        address = one.log.address
        if address not in there:
            fs, path = file_system(address)
            there[address] = bool(fs.exists(path))
        if not there[address]:
            missing.append(one)
        progress(1)
    return missing


def stored(context: JobContext, one: Input, columns: Mapping[str, str] | None) -> StoredBlob:
    """The log as an upload stores it. Raises ``BatchError`` where its bytes are others than they were, ``OSError``, and
    what an upload of it would meet."""
    settings = context.settings
    with opened(one.log) as path:
        if digest(path) != one.sha256:
            raise BatchError(say("batch.log_changed"))
        bundle = UploadBundle(
            context.blobs,
            keep_free_bytes=settings.min_free_bytes,
            expected_bytes=one.log.size,
            max_content_bytes=settings.max_log_bytes,
            look=FirstLook(columns),
        )
        try:
            for piece in _pieces(path, one.log.file_name):
                bundle.take([piece])
            return bundle.finish()[0]
        except BaseException:
            bundle.discard()
            raise


def _pieces(path: Path, name: str) -> Iterator[Piece]:
    with path.open("rb") as file:
        while data := file.read(COPY_BYTES):
            yield Piece(0, name, data)


def lost_blob(one: Input) -> StoredBlob:
    """Of a log that is not reached: a key under which there is nothing, as after a log's time is over."""
    return StoredBlob(f"{LOGS}/{uuid.uuid4().hex}", one.sha256, one.log.size, one.sha256)
