"""The drives of an archive sent one by one, a few at once, and each at most once: what was sent is in the journal."""

from __future__ import annotations

import shutil
import tempfile
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from app.cli.client import Client, ClientError, RefusedKeyError, Sent
from app.cli.uploads.delivering import deliver, ends_all, patiently
from app.cli.uploads.journal import Journal
from app.cli.uploads.rows import SENT_BEFORE
from app.core.messages import say
from app.drives.receiving.zips import content_of_files
from fusion.errors import FusionError, MalformedLogError
from fusion.formats.archives.files import File, copy_within, files_in
from fusion.formats.archives.manifest import Manifest
from fusion.messages import message_of, said, with_key

IN_FLIGHT = 4
"""Uploads at once: one waits for the disk of the service while another is on its way."""
PREPARED = 8
"""Of so many drives the files are unpacked at most."""
LONGEST_NAME = 120


@dataclass(frozen=True)
class Outcome:
    """What came of a drive: the service's id, or why it has none. ``before``: it was sent by an earlier run."""

    drive: str | None = None
    reason: str | None = None
    known: bool = False
    before: bool = False

    @property
    def status(self) -> str:
        """As the table says it."""
        if self.drive is None:
            return "not sent"
        return SENT_BEFORE if self.before else "known" if self.known else "queued"


def as_line(outcome: Outcome) -> dict[str, Any]:
    """As the journal keeps it."""
    return {
        "drive": outcome.drive,
        "known": outcome.known,
        **({"reason": outcome.reason, "said": said(outcome.reason)} if outcome.reason else {}),
    }


def from_line(line: dict[str, Any]) -> Outcome:
    """Of an earlier run."""
    reason = line.get("reason")
    return Outcome(line["drive"], with_key(reason, line.get("said")) if reason else None, True, before=True)


class ArchiveSender:
    """Sends the drives of one archive. ``send`` tells of each drive's outcome, from whatever thread."""

    def __init__(self, client: Client, journal: Journal, computation: dict[str, Any]) -> None:
        """``computation``: what ``Client.send`` takes beside files."""
        self._client, self._journal, self._computation = client, journal, computation
        self._lock = threading.Lock()
        self._end: ClientError | None = None
        """Why nothing more is sent."""

    def send(
        self, root: Path, manifest: Manifest, done: Callable[[int, Outcome], None], keys: Sequence[str]
    ) -> None:
        """Send each drive of the manifest that is not in the journal; ``keys``: the identity of each.

        Raises ``RefusedKeyError``, and ``OSError`` where there is no room to unpack.
        """
        for number, key in enumerate(keys):
            if (line := self._journal.outcome(key)) is not None:
                done(number, from_line(line))
        waiting = [number for number, key in enumerate(keys) if self._journal.outcome(key) is None]
        room = threading.Semaphore(PREPARED)
        with tempfile.TemporaryDirectory(prefix="versant-") as folder, ThreadPoolExecutor(IN_FLIGHT) as pool:
            futures = []
            for number, ready in _prepared(root, manifest, waiting, Path(folder)):
                room.acquire()

                def work(number: int = number, ready: _Ready = ready) -> None:
                    try:
                        done(number, self._one(ready, keys[number]))
                    finally:
                        ready.drop()
                        room.release()

                futures.append(pool.submit(work))
            for future in futures:
                future.result()

    def _one(self, ready: _Ready, key: str) -> Outcome:
        if ready.fault is not None:
            return Outcome(reason=ready.fault)
        if self._end is not None:
            return Outcome(reason=message_of(self._end))
        several = {"grouping": "one"} if len(ready.paths) > 1 else {"grouping": None}
        try:
            computation = self._computation | several
            sent = patiently(lambda: deliver(self._client, ready.paths, computation))
        except RefusedKeyError as error:
            self._end = error
            raise
        except ClientError as error:
            if ends_all(error):
                self._end = error
            return Outcome(reason=message_of(error))
        except (FusionError, OSError) as error:
            return Outcome(reason=message_of(error))
        outcome = _outcome(sent)
        with self._lock:
            self._journal.note(key, as_line(outcome))
        return outcome


def _outcome(sent: Sent) -> Outcome:
    drive = sent.drives[0]
    return Outcome(drive.id, drive.reason, bool(sent.documents[0].get("known")))


def keys_of(manifest: Manifest) -> list[str]:
    """The identity of each drive: of what its files hold, in whatever archive they lie."""
    return [content_of_files(manifest.files[k].content for k in drive) for drive in manifest.drives]


@dataclass(frozen=True)
class _Ready:
    """The files of a drive as they can be sent, in a folder of their own where they had to be unpacked."""

    paths: tuple[Path, ...]
    folder: Path | None
    fault: str | None = None

    def drop(self) -> None:
        """They have been sent."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


def _prepared(
    root: Path, manifest: Manifest, wanted: Sequence[int], folder: Path
) -> Iterator[tuple[int, _Ready]]:
    """The files of each drive that is wanted, as soon as all of them were met with in the archive; unpacked below
    ``folder``."""
    drives_of = defaultdict[str, list[int]](list)
    for number in wanted:
        for k in manifest.drives[number]:
            drives_of[manifest.files[k].name].append(number)
    missing = {number: len(manifest.drives[number]) for number in wanted}
    gathered: dict[int, _Gathered] = defaultdict(lambda: _Gathered(folder))
    for file in files_in(root) if wanted else ():
        for number in drives_of.pop(file.name, ()):
            gathered[number].take(file)
            missing[number] -= 1
            if not missing[number]:
                yield number, gathered.pop(number).ready()
        if not drives_of:
            break
    for number, one in gathered.items():  # a file is gone since it was looked at
        one.ready().drop()
        yield number, _Ready((), None, say("archive.changed"))


class _Gathered:
    """Files of one drive, so far."""

    def __init__(self, below: Path) -> None:
        self._below = below
        self._paths: list[Path] = []
        self._folder: Path | None = None
        self._fault: str | None = None

    def take(self, file: File) -> None:
        if file.path is not None:
            self._paths.append(file.path)
            return
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(dir=self._below))
        path = self._folder / str(len(self._paths)) / _safe_name(file.name)
        path.parent.mkdir()
        try:
            with file.open() as stream, path.open("wb") as out:
                copy_within(stream, out.write, 1 << 40, 1 << 40)
        except (MalformedLogError, OSError) as error:
            self._fault = message_of(error)
        self._paths.append(path)

    def ready(self) -> _Ready:
        return _Ready(tuple(self._paths), self._folder, self._fault)


def _safe_name(name: str) -> str:
    """The last part of a name in an archive, as a file of this machine may be called."""
    last = PurePosixPath(name).name.strip(". ") or "file"
    plain = "".join(c if c.isprintable() and c not in '\\:*?"<>|' else "_" for c in last)
    stem, dot, suffix = plain.partition(".")
    return (stem[:LONGEST_NAME] + dot + suffix)[-2 * LONGEST_NAME :].encode()[-240:].decode("utf-8", "ignore")
