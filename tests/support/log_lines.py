"""The lines that a service in this process logs, as an operator collects them: JSON, one object each."""

from __future__ import annotations

import io
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from app.core.telemetry.logs import JsonLines


class Lines:
    """What was logged so far."""

    def __init__(self, written: io.StringIO) -> None:
        self._written = written

    @property
    def text(self) -> str:
        return self._written.getvalue()

    def all(self, event: str | None = None) -> list[dict[str, Any]]:
        """Every line, or those of one event."""
        found = [json.loads(line) for line in self.text.splitlines()]
        return [line for line in found if event is None or line["event"] == event]

    def one(self, event: str) -> dict[str, Any]:
        """The only line of the event."""
        (line,) = self.all(event)
        return line


@contextmanager
def logged(level: int = logging.INFO) -> Iterator[Lines]:
    """Collect what the service's own modules log within the block."""
    written, ours = io.StringIO(), logging.getLogger("app")
    handler = logging.StreamHandler(written)
    handler.setFormatter(JsonLines("test"))
    former = ours.level
    ours.addHandler(handler)
    ours.setLevel(level)
    try:
        yield Lines(written)
    finally:
        ours.setLevel(former)
        ours.removeHandler(handler)
