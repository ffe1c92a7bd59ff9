"""Times in requests: ``datetime`` of OGC API Features, and what CQL2 writes as dates, timestamps and intervals."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta

from app.core.errors import BadQueryError

OPEN = ".."
Span = tuple[datetime | None, datetime | None]
"""First and last moment, both included; None: open."""

_DATE = re.compile(r"\d{4}-\d{2}-\d{2}", re.ASCII)
_TIME = re.compile(r"\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}:\d{2}(\.\d{1,9})?(Z|[+-]\d{2}:\d{2})", re.ASCII)
_MICROSECOND = timedelta(microseconds=1)
_SECONDS = re.compile(r":\d{2}:\d{2}\.(\d{4,})")


def moment(text: str) -> datetime:
    """The moment of a time of RFC 3339, or the first of a date in UTC; ``ValueError`` for anything else."""
    upper = text.strip().upper()
    if _DATE.fullmatch(upper):
        return datetime.fromisoformat(upper).replace(tzinfo=UTC)
    if not _TIME.fullmatch(upper):
        raise ValueError(f"{text!r} is no time; write 2026-11-20T09:13:02Z or 2026-11-20")
    try:
        return datetime.fromisoformat(upper).astimezone(UTC)
    except (ValueError, OverflowError):
        raise ValueError(f"{text!r}: there is no such day or hour") from None


def span(text: str) -> Span:
    """First and last moment of a time as it is written: a date is a day, a time what its digits leave open.

    Times are served in milliseconds and kept in microseconds, so that a time that was read here means the millisecond.
    """
    first = moment(text)
    if _DATE.fullmatch(text.strip()):
        return first, first + timedelta(days=1) - _MICROSECOND
    finest = _MICROSECOND if _SECONDS.search(text) else timedelta(milliseconds=1)
    return first, first + finest - _MICROSECOND


def interval(first: str, last: str) -> Span:
    """From one time to another, each of which may be ``..`` or nothing; ``ValueError`` if it ends before it begins."""
    start = None if first in {"", OPEN} else span(first)[0]
    end = None if last in {"", OPEN} else span(last)[1]
    if start is not None and end is not None and end < start:
        raise ValueError(f"{first}/{last} ends before it begins")
    return start, end


def parse_datetime(text: str) -> Span:
    """What ``datetime`` asks for; ``BadQueryError`` for what is neither time nor interval."""
    try:
        parts = text.split("/")
        if len(parts) > 2:
            raise ValueError("it has more than two ends")
        if len(parts) == 2 and all(part in {"", OPEN} for part in parts):
            raise ValueError("one end must be said")
        return span(text) if len(parts) == 1 else interval(*parts)
    except (ValueError, OverflowError) as error:
        raise BadQueryError(
            f"datetime: {error}. Write 2026-11-20T00:00:00Z, or an interval: 2026-11-20/..", field="datetime"
        ) from None
