"""The form of every answer and file: digits, times, compact JSON, files that appear complete or not at all."""

from __future__ import annotations

import errno
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from pydantic import PlainSerializer

from fusion.messages import LANGUAGES

GEO_JSON = "application/geo+json"

# Digits after the point
COORDINATE_DIGITS = 7  # degrees: OpenStreetMap's own resolution, about 1 cm
LENGTH_DIGITS = 3  # metres: a millimetre
SLOPE_DIGITS = 4  # percent: 1 mm per kilometre, far below any sigma

WHOLE = 1e15
"""A number of this size or more has no decimal places to speak of, and is written as it is."""

_AT_ONCE = 1000  # values of a column that are written in one call, well below a millisecond


def rounded(value: float | None, digits: int) -> float | None:
    """``value`` rounded; None where it is None, NaN or infinite.

    By these steps and no others: PostgreSQL and numpy take the same, so that all outputs agree on ties.
    """
    if value is None or not math.isfinite(value):
        return None
    if abs(value) >= WHOLE:
        return float(value)
    power = 10.0**digits
    return round(float(value) * power) / power + 0.0  # -0.0 would print as such


def utc_text(moment: datetime | None) -> str | None:
    """RFC 3339 in UTC, to the millisecond, with a Z; ValueError for a naive time."""
    if moment is None:
        return None
    if moment.tzinfo is None:
        raise ValueError("a time without its zone cannot be written as UTC")
    return moment.astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def dumps(value: Any) -> str:
    """Compact JSON; ValueError for a NaN, which JSON does not have."""
    return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))


def varint(number: int) -> bytes:
    """A number from 0 on in as many bytes as it needs, seven bits each, the last of which says that it is."""
    encoded = bytearray()
    while number > 127:
        encoded.append(number & 127 | 128)
        number >>= 7
    encoded.append(number)
    return bytes(encoded)


def geojson_text(document: Mapping[str, Any]) -> bytes:
    """The document as compact JSON. One feature is written at a time.

    So that features need not be held, and no other thread is kept waiting: a whole document is written in one call,
    which lets none run.
    """
    members = {name: value for name, value in document.items() if name != "features"}
    if "features" not in document:
        return dumps(members).encode()
    features = b",".join([dumps(feature).encode() for feature in document["features"]])
    return b"".join((dumps(members)[:-1].encode(), b',"features":[', features, b"]}"))


def collection_chunks(
    features: Iterable[Mapping[str, Any]], members: Mapping[str, Any] | None = None
) -> Iterator[str]:
    """The text of a FeatureCollection, a feature at a time, in constant memory.

    ``members`` are further top-level members such as ``links``; they come before ``features``.
    """
    yield dumps({"type": "FeatureCollection", **(members or {})})[:-1] + ',"features":['
    separator = ""
    for feature in features:
        yield separator + dumps(feature)
        separator = ",\n"
    yield "]}\n"


def columns_text(document: Mapping[str, Any]) -> bytes:
    """A document of long columns as compact JSON, a part of a column at a time: see ``geojson_text``."""
    return (
        "{" + ",".join(f"{dumps(name)}:{_in_parts(value)}" for name, value in document.items()) + "}"
    ).encode()


def _in_parts(value: Any) -> str:
    if not isinstance(value, list):
        return dumps(value)
    parts = (value[start : start + _AT_ONCE] for start in range(0, len(value), _AT_ONCE))
    return "[" + ",".join(dumps(part)[1:-1] for part in parts) + "]"


Moment = Annotated[datetime, PlainSerializer(utc_text, return_type=str, when_used="json-unless-none")]
"""A time in a model of pydantic, written by ``utc_text``."""


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Where to write what becomes ``path`` at the end of the block; whatever interrupts that, ``path`` stays as it was.

    What is no file, such as ``/dev/stdout``, is written to as it is. The place ends as ``path`` does, in lower case,
    since writers go by that. Raises ``OSError`` that names ``path``, or its folder where that is missing.
    """
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, "Is a directory", str(path))
    if path.exists() and not path.is_file():
        yield path
        return
    if not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, "There is no such folder", str(path.parent))
    partial = path.with_name(f".{path.stem}.partial{path.suffix.lower()}")
    try:
        yield partial
        partial.replace(path)
    except OSError as error:
        if error.filename == str(partial):  # a name that nobody gave
            error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def preferred(accept: str | None, offered: Sequence[str]) -> str | None:
    """The media type of ``offered`` that the Accept header likes best, the first of equals; None: none.

    At equal weight a type that is named beats one that only a wildcard covers, which is what a browser's
    header for pictures means.
    """
    if not accept or not accept.strip():
        return offered[0]
    ranges = [_parsed(item) for item in accept.split(",") if item.strip()]
    best = max(offered, key=lambda media_type: _rank(media_type, ranges))
    return best if _rank(best, ranges)[0] > 0 else None


def language_of(accepted: str) -> str:
    """The language that an Accept-Language header likes best; English where it likes none."""
    without_countries = re.sub(r"(?<=[a-z])-\w+", "", accepted.lower())
    return preferred(without_countries, LANGUAGES) or LANGUAGES[0]


def _rank(media_type: str, ranges: list[tuple[str, float]]) -> tuple[float, int]:
    """(weight, how exactly it is named) by the most specific range that covers the type."""
    wildcard = media_type.split("/", maxsplit=1)[0] + "/*"
    exactness = {media_type: 3, wildcard: 2, "*/*": 1}
    matches = [(exactness[name], weight) for name, weight in ranges if name in exactness]
    specific, weight = max(matches, default=(0, 0.0))
    return (weight, specific)


def _parsed(item: str) -> tuple[str, float]:
    name, *parameters = (part.strip().lower() for part in item.split(";"))
    weight = next((p[2:] for p in parameters if p.startswith("q=")), "1")
    try:
        return name, min(max(float(weight), 0.0), 1.0)
    except ValueError:
        return name, 0.0
