"""Long columns of numbers and times as JSON and CSV, converted as arrays."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Any

import numpy as np

from app.core.text import WHOLE
from fusion.types import Floats

LINES_AT_ONCE = 1000
"""Of a table that are written in one go, well below a millisecond each."""


def numbers(values: Floats, digits: int) -> list[float | None]:
    """As ``app.core.text.rounded`` does it of each: None where a value is NaN or infinite."""
    power = 10.0**digits
    with np.errstate(invalid="ignore", over="ignore"):
        near = np.where(np.abs(values) >= WHOLE, values, np.round(values * power) / power + 0.0)
    finite = np.isfinite(values)
    if finite.all():
        return list(near.tolist())
    column = near.astype(object)
    column[~finite] = None
    return list(column)


def time_texts(time_s: Floats) -> list[str | None]:
    """RFC 3339 of Unix seconds, to the millisecond; None for NaN."""
    finite = np.isfinite(time_s)
    seconds = np.floor(np.where(finite, time_s, 0.0))
    micros = seconds.astype(np.int64) * 1_000_000 + np.round(
        (np.where(finite, time_s, 0.0) - seconds) * 1e6
    ).astype(np.int64)
    texts = np.datetime_as_string(micros.astype("M8[us]").astype("M8[ms]"), unit="ms", timezone="UTC")
    return [text if there else None for text, there in zip(texts.tolist(), finite.tolist(), strict=True)]


def csv_chunks(columns: Mapping[str, Sequence[Any]]) -> Iterator[str]:
    """The text of a table of these columns of one length, piece by piece, beginning with their names (RFC 4180).

    An empty cell is unknown. Texts stand in quotes where they have to.
    """
    table = csv.writer(_Echo())
    yield table.writerow(columns)
    rows = (map(_cell, row) for row in zip(*columns.values(), strict=True))
    while lines := "".join(map(table.writerow, islice(rows, LINES_AT_ONCE))):
        yield lines


class _Echo:
    """What is written to it comes back: a line of a table."""

    def write(self, line: str) -> str:
        return line


def _cell(value: Any) -> Any:
    return str(value).lower() if isinstance(value, bool) else value
