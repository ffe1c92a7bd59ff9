"""The header of a CSV log: what its cells are called, which are columns of ours, and where the rows begin."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from fusion.errors import MalformedLogError
from fusion.formats import csv_names
from fusion.formats.base import Notes
from fusion.formats.csv_names import DATE, TIME, Cell, Known
from fusion.registry import LOG_COLUMNS

COLUMNS = LOG_COLUMNS
NUMBERS = tuple(name for name in COLUMNS if name != "time")
MOST_CELLS = 1000
DELIMITERS = ",;\t|"
LINE_END = re.compile(rb"\r\n|\r|\n")
_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t|\n]) *-?\d{1,20},\d{1,20} *(?:[;\t|\r\n]|$)")
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Schema:
    """What a kind of CSV may have: its columns, those of them that hold words, and which are ``lacking`` of those.

    The columns ``clocks`` hold times as texts or as numbers since 1970. ``named`` is what a person says of names,
    ours -> the header's. ``loose``: names of other programs are understood (``csv_names``). ``part``: the file may hold
    a part of a drive only.
    """

    columns: tuple[str, ...]
    lacking: Callable[[Collection[str]], list[str]]
    words: frozenset[str] = frozenset()
    named: Mapping[str, str] = field(default_factory=dict)
    loose: bool = False
    part: bool = False
    clocks: frozenset[str] = frozenset({TIME})
    understood: Callable[[list[str], Schema], Known] | None = None
    """How the header is understood, where not by names alone."""


@dataclass(frozen=True)
class Layout:
    """How the cells lie: ``known`` gives the cell of each column of ours, ``width`` counts all cells.

    ``body_at`` is the offset of the first row, ``line`` the number of its line.
    """

    delimiter: str
    width: int
    known: dict[str, Cell]
    comma: bool
    body_at: int
    line: int
    schema: Schema

    def is_text(self, name: str) -> bool:
        """Whether a column is read as it stands."""
        return name in self.schema.clocks or name in self.schema.words or name == DATE


def from_utf16(data: bytes) -> bytes:
    """The same text in UTF-8 if it is UTF-16, which spreadsheets write, else ``data`` itself."""
    return data.decode("utf-16", "replace").encode() if data[:2] in _UTF16 else data


def text_head(head: bytes) -> bytes:
    """The beginning of a text in UTF-8, if it is UTF-16 that was cut anywhere, else ``head`` itself."""
    return from_utf16(head[: len(head) // 2 * 2]) if head[:2] in _UTF16 else head


def first_line(data: bytes) -> tuple[int, int, bytes]:
    """Number, offset and content of the first line that is neither blank nor a # comment."""
    start = len(_BOM) if data.startswith(_BOM) else 0
    for number, match in enumerate(re.finditer(rb"[^\r\n]*(?:\r\n|\r|\n|$)", data[start:65536]), 1):
        line = match.group().strip()
        if line and not line.startswith(b"#"):
            return number, start + match.start() + match.group().index(line), line
    return 1, start, b""


def delimiter_of(line: bytes) -> str:
    """The delimiter that occurs most in the header."""
    return max(DELIMITERS, key=lambda d: line.count(d.encode()))


def cells_as_written(line: bytes, delimiter: str) -> list[str]:
    """The names in the header as they are written, without blanks and quotes around."""
    return [c.strip().strip('"').strip() for c in line.decode("utf-8", "replace").split(delimiter)]


def header_cells(line: bytes, delimiter: str) -> list[str]:
    """The names in the header, lower case, without blanks and quotes around."""
    return [cell.lower() for cell in cells_as_written(line, delimiter)]


def understood_header(data: bytes, schema: Schema) -> tuple[Known, list[str], str, int]:
    """What the header says: the columns, its cells, the delimiter, and the number of its line.

    Raises ``MalformedLogError`` naming the required columns that it lacks, or one that a person named and it has not.
    """
    number, _, line = first_line(data)
    delimiter = delimiter_of(line)
    header = cells_as_written(line, delimiter)
    if len(header) > MOST_CELLS:
        raise MalformedLogError(
            f"The first line of this CSV, line {number}, has {len(header)} cells; {MOST_CELLS} are read at most. Put a "
            "header before the rows.",
            where=f"line {number}",
        )
    if schema.understood is not None:
        columns = schema.understood(header, schema)
    else:
        columns = csv_names.known_columns(
            header, schema.columns, schema.named, loose=schema.loose, part=schema.part
        )
    missing = schema.lacking(columns.cells)
    if missing:
        raise MalformedLogError(csv_names.missing_sentence(missing, header, number), where=f"line {number}")
    return columns, header, delimiter, number


def sections(data: bytes, notes: Notes) -> Iterator[tuple[bytes, int]]:
    """The parts of a text that each begin with a header, with the number of lines before.

    Some programs write the header again in the middle, when recording goes on, and with other columns when these
    changed. A repeated header is made a blank line.
    """
    at, line = first_line(data)[1:]
    lead = line[: line.find(delimiter_of(line).encode()) + 1]
    starts = sorted(_lines_with(lead, data, at)) if len(lead) > 3 else []
    cuts, blanks, current = [0], list[tuple[int, int]](), line
    for start in starts:
        end = LINE_END.search(data, start)
        again = data[start : end.start() if end else len(data)].strip()
        if again == current:
            blanks.append((start, end.start() if end else len(data)))
        elif any(c.isalpha() for c in again.decode("ascii", "replace").split(",")[-1]):
            cuts.append(start)
            current = again
    if blanks:
        notes.repaired["headers repeated among the rows"] += len(blanks)
        data, cuts = _without(data, blanks, cuts)
    before = 0
    for start, stop in pairwise([*cuts, len(data)]):
        piece = data[start:stop] if len(cuts) > 1 else data
        yield piece, before
        if stop < len(data):
            before += len(LINE_END.findall(piece))


def _lines_with(lead: bytes, data: bytes, after: int) -> Iterator[int]:
    """Offsets of the lines behind one that begin with ``lead``."""
    for line_end in (b"\n", b"\r"):
        at = data.find(line_end + lead, after)
        while at >= 0:
            yield at + 1
            at = data.find(line_end + lead, at + 1)


def _without(data: bytes, blanks: list[tuple[int, int]], cuts: list[int]) -> tuple[bytes, list[int]]:
    """The text without some stretches, and where offsets of it are then."""
    ends = [0, *(end for _, end in blanks)]
    starts = [*(start for start, _ in blanks), len(data)]
    lost = [sum(end - start for start, end in blanks if end <= cut) for cut in cuts]
    joined = b"".join(data[end:start] for end, start in zip(ends, starts, strict=True))
    return joined, [cut - less for cut, less in zip(cuts, lost, strict=True)]


def layout_of(data: bytes, notes: Notes, schema: Schema, *, lines_before: int = 0) -> Layout:
    """Read the header; raises as ``understood_header``."""
    columns, header, delimiter, number = understood_header(data, schema)
    _, at, line = first_line(data)
    for sentence in (csv_names.taken_sentence(columns), csv_names.unknown_sentence(columns, schema.columns)):
        if sentence:
            notes.warn(sentence)
    twice = sorted(
        c for c, times in Counter(map(str.lower, header)).items() if times > 1 and c in columns.cells
    )
    if twice:
        notes.warn(f"The CSV names columns twice, of which the first is used: {', '.join(twice)}.")
    at += len(line)
    while data[at : at + 1] in (b" ", b"\t"):
        at += 1
    end = LINE_END.match(data, at)
    at = end.end() if end else at
    comma = delimiter != "," and bool(_DECIMAL_COMMA.search(data[at : at + 65536]))
    return Layout(delimiter, len(header), columns.cells, comma, at, number + 1 + lines_before, schema)
