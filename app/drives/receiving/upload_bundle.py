"""Upload bundles: the files of one upload become one blob, a single file as it came, several as a zip.

Knows no request and no log. Its calls block, so they run in threads.
"""

from __future__ import annotations

from collections.abc import Iterable

from app.core.blobs import BlobStore, BlobWriter, StoredBlob
from app.core.errors import BadRequestError
from app.core.messages import say
from app.core.receiving.body import FILENAME_LENGTH, Piece, joined
from app.drives.receiving.first_look import FirstLook
from app.drives.receiving.zips import MAGIC_BYTES, ZipWriter, content_of_zip, is_zip

COPY_BYTES = 1 << 20


class UploadBundle:
    """Take the pieces of an upload, then ``finish`` it, or ``discard`` it: nothing of it stays then.

    Only when a second file begins it is known that there are several. The first is then copied into the zip, and the
    others go there as they come.
    """

    def __init__(
        self,
        blobs: BlobStore,
        *,
        keep_free_bytes: int,
        expected_bytes: int,
        max_content_bytes: int,
        look: FirstLook,
    ) -> None:
        """The limits are those of ``BlobStore.writer``; of several files each has its own content, none a sum.

        ``look`` sees the files while they come, those in a zip when it is there, and may refuse them at the end.
        """
        self._look = look
        self._blobs = blobs
        self._keep_free_bytes = keep_free_bytes
        self._max_content_bytes = max_content_bytes
        self._names: list[str] = []
        self._head = b""
        self._zip: ZipWriter | None = None
        self._writer = self._new_writer(expected_bytes)
        self._single = self._writer

    @property
    def is_zip(self) -> bool:
        """Whether the blob is one: ours, of several files, or that of whoever sent it."""
        return self._zip is not None or is_zip(self._head)

    def take(self, pieces: Iterable[Piece]) -> None:
        """Write the next pieces; raises what ``BlobWriter`` and ``ZipWriter`` raise."""
        for piece in joined(pieces):
            if piece.file == len(self._names):
                self._begin(piece.name)
            self._look.feed(piece.data)
            if self._zip is not None:
                self._zip.write(piece.data)
                continue
            if len(self._head) < MAGIC_BYTES:
                self._head += piece.data[:MAGIC_BYTES]
            self._writer.write(piece.data)

    def finish(self) -> tuple[StoredBlob, str]:
        """The blob, and the names of its files.

        Raises ``BadRequestError`` where there is not one byte, what ``content_of_zip`` raises of a zip, and what
        ``FirstLook`` does of files among which no log is.
        """
        names = ", ".join(self._names)[:FILENAME_LENGTH]
        content = self._content()
        self._look.check()
        return self._writer.finish(content), names

    def discard(self) -> None:
        """Forget what was written."""
        try:
            if self._zip is not None:
                self._zip.drop()
        finally:
            for writer in {self._single, self._writer}:
                writer.discard()

    def _content(self) -> str | None:
        """The identity of the files in a zip, ours or theirs; None of a file that is no zip."""
        if self._zip is not None:
            return self._zip.finish()
        if not self._writer.size_bytes:
            raise BadRequestError(say("upload.empty"), field="file")
        if not is_zip(self._head):
            return None
        with self._writer.reopened() as file:
            self._look.again()
            return content_of_zip(file, self._max_content_bytes, self._look)

    def _begin(self, name: str) -> None:
        if len(self._names) == 1:
            self._begin_zip()
        self._names.append(name)
        self._look.begin()
        if self._zip is not None:
            self._zip.begin(name)

    def _begin_zip(self) -> None:
        """Begin the zip with the file that came first."""
        self._writer = self._new_writer(0)
        self._zip = ZipWriter(self._writer.write, self._max_content_bytes)
        self._zip.begin(self._names[0])
        with self._single.reopened() as file:
            while data := file.read(COPY_BYTES):
                self._zip.write(data)
        self._single.discard()

    def _new_writer(self, expected_bytes: int) -> BlobWriter:
        return self._blobs.writer(
            keep_free_bytes=self._keep_free_bytes,
            expected_bytes=expected_bytes,
            max_content_bytes=self._max_content_bytes,
        )
