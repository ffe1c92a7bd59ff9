"""The header of a CSV log: what its cells are called, which are columns of ours, and where the rows begin."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from fusion.errors import MalformedLogError
from fusion.formats.base import Notes
from fusion.formats.tables import names as csv_names
from fusion.formats.tables.names import DATE, Cell, Known, Schema
from fusion.messages import say
from fusion.registry import LOG_COLUMNS

COLUMNS = LOG_COLUMNS
MOST_CELLS = 1000
DELIMITERS = ",;\t|"
LINE_END = re.compile(rb"\r\n|\r|\n")
_REST_OF_LINE = re.compile(rb"[ \t]*(?:\r\n|\r|\n)?")
_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t|\n]) *-?\d{1,20},\d{1,20} *(?:[;\t|\r\n]|$)")
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_BOM = b"\xef\xbb\xbf"


@dataclass(frozen=True)
class Header:
    """The first line that is neither blank nor a # comment: its number, its offset, and its cells as they are written,
    without blanks and quotes around."""

    number: int
    at: int
    line: bytes
    delimiter: str
    cells: list[str]

    @property
    def names(self) -> list[str]:
        """The cells in small letters."""
        return [cell.lower() for cell in self.cells]


@dataclass(frozen=True)
class Layout:
    """How the cells lie: ``known`` gives the cell of each column of ours.

    ``body_at`` is the offset of the first row, ``line`` the number of its line.
    """

    header: Header
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


def header_of(data: bytes) -> Header:
    """The header of a text, or of its beginning; where there is none, one cell that is empty.

    Of UTF-16, offsets are those of the same text in UTF-8.
    """
    data = from_utf16(data)
    start = len(_BOM) if data.startswith(_BOM) else 0
    number, at, line = 1, start, b""
    for count, match in enumerate(re.finditer(rb"[^\r\n]*(?:\r\n|\r|\n|$)", data[start:65536]), 1):
        content = match.group().strip()
        if content and not content.startswith(b"#"):
            number, at, line = count, start + match.start() + match.group().index(content), content
            break
    delimiter = max(DELIMITERS, key=lambda d: line.count(d.encode()))
    cells = [c.strip().strip('"').strip() for c in line.decode("utf-8", "replace").split(delimiter)]
    return Header(number, at, line, delimiter, cells)


def understood_header(data: bytes, schema: Schema) -> tuple[Known, Header]:
    """The header, and which columns it has.

    Raises ``MalformedLogError`` naming the required columns that it lacks, or one that a person named and it has not.
    """
    header = header_of(data)
    cells, where = header.cells, say("place.line", n=header.number)
    if len(cells) > MOST_CELLS:
        raise MalformedLogError(
            say("csv.too_many_cells", where=where, cells=len(cells), most=MOST_CELLS),
            where=where,
        )
    columns = (schema.understood or csv_names.known_columns)(cells, schema)
    missing = schema.lacking(columns.cells)
    if missing:
        raise MalformedLogError(csv_names.missing_sentence(missing, cells, header.number), where=where)
    return columns, header


def sections(data: bytes, notes: Notes) -> Iterator[tuple[bytes, int]]:
    """The parts of a text that each begin with a header, with the number of lines before.

    Some programs write the header again in the middle, when recording goes on, and with other columns when these
    changed. A repeated header is made a blank line.
    """
    header = header_of(data)
    lead = header.line[: header.line.find(header.delimiter.encode()) + 1]
    starts = sorted(_lines_with(lead, data, header.at)) if len(lead) > 3 else []
    cuts, blanks, current = [0], list[tuple[int, int]](), header.line
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
    columns, header = understood_header(data, schema)
    for sentence in (csv_names.taken_sentence(columns), csv_names.unknown_sentence(columns, schema.columns)):
        if sentence:
            notes.warn(sentence)
    twice = sorted(c for c, times in Counter(header.names).items() if times > 1 and c in columns.cells)
    if twice:
        notes.warn(say("csv.named_twice", twice=", ".join(twice)))
    at = header.at + len(header.line)
    rest = _REST_OF_LINE.match(data, at)
    at = rest.end() if rest else at
    comma = header.delimiter != "," and bool(_DECIMAL_COMMA.search(data[at : at + 65536]))
    return Layout(header, columns.cells, comma, at, header.number + 1 + lines_before, schema)
