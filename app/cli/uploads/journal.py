"""What was sent of an archive, kept in a file of lines: an upload that is cut off at any moment goes on after it.

A line is written whole, after the service has answered. The last may be cut off: then the service has the drive, and
says so when it is sent again. Knows no client and no file of an archive.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
from pathlib import Path
from typing import IO, Any, Self

from app.core.messages import say
from fusion.errors import FusionError

VERSION = 1


class JournalError(FusionError):
    """The journal cannot be used."""

    kind = "journal"


def journal_name(server: str, key: str | None, roots: list[Path]) -> str:
    """What the journal of an upload is called: by the service, by whose key, and by what is uploaded."""
    named = "\n".join([server, key or "", *(str(root.absolute()) for root in roots)])
    return f"{hashlib.sha256(named.encode()).hexdigest()[:16]}.jsonl"


class Journal:
    """Outcomes by the identity of what was sent; use as a context manager. One process at a time has it."""

    def __init__(self, path: Path, server: str) -> None:
        """Opens or begins it; raises ``JournalError`` for one of another service, of another kind, or in use."""
        self.path = path
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file: IO[bytes] = path.open("a+b")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise JournalError(say("journal.in_use", path=path)) from None
        try:
            self._sent = self._read(server)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._sent)

    def outcome(self, content: str) -> dict[str, Any] | None:
        """What came of that when it was sent; None where it was not."""
        return self._sent.get(content)

    def note(self, content: str, outcome: dict[str, Any]) -> None:
        """Keep what came of it: on the disk when this returns."""
        self._sent[content] = outcome
        self._write({"content": content, **outcome})

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line, ensure_ascii=False).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self, server: str) -> dict[str, dict[str, Any]]:
        self._file.seek(0)
        data = self._file.read()
        whole = data[: data.rfind(b"\n") + 1]
        if len(whole) < len(data):  # cut off while it was written
            self._file.truncate(len(whole))
        try:
            lines = [json.loads(line) for line in whole.splitlines()]
            if not lines:
                self._write({"versant upload": VERSION, "server": server})
                return {}
            head = lines[0]
            if head.get("versant upload") != VERSION or head.get("server") != server:
                raise JournalError(say("journal.of_another", path=self.path))
            return {str(line.pop("content")): line for line in lines[1:]}
        except (ValueError, KeyError, AttributeError):
            raise JournalError(say("journal.of_another", path=self.path)) from None
