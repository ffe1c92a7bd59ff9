"""Lines of the log: one for each request and each event of a drive, as text or as JSON, with the ids of their subjects.

They hold nothing of a track: ids, counts and times, never a place. Names of files, which
may hold a person's, are logged at DEBUG alone. To be sure, numbers as long as those of places are blanked in
whatever comes: messages and tracebacks of others, words of the database.
"""

from __future__ import annotations

import json
import logging
import os
import re
import sys
import traceback
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from datetime import UTC, datetime
from typing import Any, TextIO

from app.core.db import plain_json, plain_text
from app.core.settings import Settings
from app.core.text import utc_text
from fusion.messages import said

FIELDS = "versant"
"""The attribute of a record that holds what ``tell`` was given."""
CHATTY = (
    "procrastinate",
    "uvicorn",
    "httpx",
    "httpcore",
    "alembic",
    "matplotlib",
    "urllib3",
    "opentelemetry",
)
"""What the queue or a library says of each step is of interest only while it is debugged."""
DIGITS = 3
"""Of figures in events: milliseconds and metres; places have more."""

_IDS: ContextVar[Mapping[str, str]] = ContextVar("versant_ids", default={})  # noqa: B039 - it is never changed

# A degree with four decimals is a street. Times and figures of events have three.
_PLACE = re.compile(r"(?<![\w.])[-+]?\d{1,3}\.\d{4,}")
_GEOMETRY = re.compile(r"\b0[01][0-9A-F]{40,}\b")
_BLANK = "(blanked)"
_BARE = re.compile(r"[\w.:/@+-]+")


@contextmanager
def about(**ids: object) -> Iterator[None]:
    """Every line that is logged within the block, in whatever thread it starts, names these ids; None: not this one."""
    texts = {name: str(value) for name, value in ids.items() if value is not None}
    token = _IDS.set({**_IDS.get(), **texts})
    try:
        yield
    finally:
        _IDS.reset(token)


def present_ids() -> Mapping[str, str]:
    """The ids that lines name here."""
    return _IDS.get()


def tell(logger: logging.Logger, event: str, /, *, level: int = logging.INFO, **fields: Any) -> None:
    """Log an event with figures and ids of its own; a field that is None is left out."""
    if logger.isEnabledFor(level):
        logger.log(level, event, extra={FIELDS: {k: v for k, v in fields.items() if v is not None}})


def blanked(text: str) -> str:
    """The text without numbers that could be places."""
    return _GEOMETRY.sub(_BLANK, _PLACE.sub(_BLANK, text))


def reason_text(reason: str | None) -> Any:
    """The reason of a failure as it may be stored: operators see it too, so it holds no place."""
    return plain_text(None if reason is None else blanked(reason))


def said_of_failure(reason: str, where: str | None) -> dict[str, Any] | None:
    """Keys and parameters of the reason of a failure and of its place, as they may be stored; None: neither has one."""
    both = {"reason": said(reason), "where": said(where)}
    return plain_json(_without_places(both)) if any(both.values()) else None


def _without_places(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _without_places(one) for name, one in value.items()}
    if isinstance(value, list):
        return [_without_places(one) for one in value]
    if isinstance(value, float) and blanked(repr(value)) != repr(value):
        return _BLANK
    return blanked(value) if isinstance(value, str) else value


class TextLines(logging.Formatter):
    """``time LEVEL process logger: event name=value ...``, and the lines of a traceback."""

    def __init__(self, process: str) -> None:
        super().__init__()
        self._process = process

    def format(self, record: logging.LogRecord) -> str:
        """The record, and what could be places is blanked."""
        figures = getattr(record, FIELDS, {}).items()
        rounded = {name: round(v, DIGITS) if isinstance(v, float) else v for name, v in figures}
        trace = None
        if record.exc_info and record.exc_info[0] is not None:
            trace = "".join(traceback.format_exception(*record.exc_info)).rstrip()
        moment = str(utc_text(datetime.fromtimestamp(record.created, UTC)))
        return blanked(self.line(record, moment, {**_IDS.get(), **rounded}, trace))

    def line(
        self, record: logging.LogRecord, moment: str, fields: Mapping[str, Any], trace: str | None
    ) -> str:
        """The record, its ids and figures, and a traceback where there is one."""
        words = (f"{name}={_word(value)}" for name, value in fields.items())
        message = " ".join([_one_line(record.getMessage().rstrip()), *words])
        head = f"{moment} {record.levelname} {self._process} {record.name}: {message}"
        return head if trace is None else f"{head}\n{trace}"


class JsonLines(TextLines):
    """One JSON object a line; ``error`` holds a traceback."""

    def line(
        self, record: logging.LogRecord, moment: str, fields: Mapping[str, Any], trace: str | None
    ) -> str:
        """The object; the fields of every line come first and cannot be overwritten."""
        own = {
            "time": moment,
            "level": record.levelname,
            "process": self._process,
            "logger": record.name,
            "event": record.getMessage(),
        }
        more = {} if trace is None else {"error": trace}
        theirs = {name: value for name, value in fields.items() if name not in own}
        return json.dumps({**own, **theirs, **more}, default=str, ensure_ascii=False)


class _StandardError(logging.StreamHandler[TextIO]):
    """Standard error as it is when a line is written: a program that replaces it closes its replacement."""

    @property
    def stream(self) -> TextIO:
        """Where lines go."""
        return sys.stderr

    @stream.setter
    def stream(self, stream: TextIO) -> None:
        """It is never another one."""


def begin_logging(settings: Settings, process: str) -> None:
    """Log to standard error as the settings say, all libraries included; ``process`` says which one this is."""
    lines = {"json": JsonLines, "text": TextLines}[settings.log_format]
    handler = _StandardError()
    handler.setFormatter(lines(f"{process}[{os.getpid()}]"))
    root = logging.getLogger()
    for former in [one for one in root.handlers if isinstance(one.formatter, TextLines)]:
        root.removeHandler(former)
    root.addHandler(handler)
    root.setLevel(settings.log_level)
    logging.captureWarnings(capture=True)
    quiet = max(logging.WARNING, root.level) if root.level > logging.DEBUG else root.level
    for chatty in CHATTY:
        logging.getLogger(chatty).setLevel(quiet)


def _word(value: object) -> str:
    text = str(value)
    return text if _BARE.fullmatch(text) else f'"{_one_line(json.dumps(text, ensure_ascii=False)[1:-1])}"'


def _one_line(text: str) -> str:
    """What a request brought could else begin a line of its own, or tell a terminal what to do."""
    return text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
