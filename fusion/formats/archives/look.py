"""A look at a file of an archive: whether it is a drive on roads, of what sport, from when to when and how far.

Of a log only the ends are read as one; the bytes between them are hashed and forgotten. So thousands of files take
minutes, and the memory of one end.
"""

from __future__ import annotations

import gzip
import hashlib
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import IO, Protocol, cast

import numpy as np

from fusion.errors import LogError, MalformedLogError
from fusion.formats import FORMATS, MAX_BYTES, glance_at, in_short, refuse_head
from fusion.formats.archives.sports import ON_ROADS, family
from fusion.formats.container import CHUNK_BYTES, GZIP_MAGIC, most_unpacked
from fusion.formats.glance import EXCERPT_BYTES, HEAD_BYTES, Ends, Glance, Told, along_m
from fusion.messages import say

GZIP_LAYERS = 2
THINNED_S, FEW_POSITIONS = 10.0, 200


class Kind(StrEnum):
    """What a file of an archive is. What is no drive is called as errors of logs are, where there is one."""

    DRIVE = "drive"
    """A drive, or a part of one, such as navigation data."""
    NOT_ON_ROADS = "not-on-roads"
    NO_POSITIONS = "empty-log"
    NOT_A_LOG = "unknown-format"
    BROKEN = "malformed-log"
    UNREADABLE = "bad-log"
    REPEATED = "repeated"
    ALONE = "no-drive"
    """It makes no drive by itself and goes with none of the others."""
    TOO_LARGE = "too-large"


@dataclass(frozen=True, eq=False)
class Looked:
    """What a look at a file tells. ``content`` is the SHA-256 of what it unpacks to; ``glance`` where it is a drive's.

    ``reason``: why it is none; ``sport``: a family of sports, empty where nobody tells; times are Unix seconds, NaN
    unknown; ``size`` is how many bytes it unpacks to, of one too large how many of it were read.
    """

    name: str
    kind: Kind
    reason: str = ""
    sport: str = ""
    first_s: float = np.nan
    last_s: float = np.nan
    distance_m: float = np.nan
    size: int = 0
    content: str = ""
    glance: Glance = field(default_factory=Glance)

    @property
    def duration_s(self) -> float:
        """From its first time to its last, NaN unknown."""
        return self.last_s - self.first_s

    def as_other(self, kind: Kind, reason: str) -> Looked:
        """The same of another kind."""
        return replace(self, kind=kind, reason=reason)


def ends_of(stream: IO[bytes], max_bytes: int, packed_bytes: int | None = None) -> tuple[Ends, str]:
    """The ends of what a file unpacks to, and the digest of all of it: up to damage, and to ``max_bytes``.

    ``packed_bytes``: how many it takes where it is packed; one that unpacks to too many times that is read no further.
    """
    head, tail, size, digest = bytearray(), b"", 0, hashlib.sha256()
    most = max_bytes if packed_bytes is None else most_unpacked(packed_bytes)
    try:
        stream = _unpacked(stream)
        while size < min(max_bytes, most) and (piece := stream.read(CHUNK_BYTES)):
            size += len(piece)
            digest.update(piece)
            room = HEAD_BYTES - len(head)
            head += piece[:room]
            tail = (tail + piece[room:])[-EXCERPT_BYTES:]
    except (gzip.BadGzipFile, EOFError, zlib.error):
        pass  # whoever reads all of it says what is wrong with it
    return Ends(bytes(head), tail, size), digest.hexdigest()


def _unpacked(stream: IO[bytes]) -> IO[bytes]:
    for _ in range(GZIP_LAYERS):
        if cast("_Peeking", stream).peek(len(GZIP_MAGIC))[: len(GZIP_MAGIC)] != GZIP_MAGIC:
            break
        stream = cast("IO[bytes]", gzip.GzipFile(fileobj=stream))
    return stream


class _Peeking(Protocol):
    def peek(self, n: int, /) -> bytes:
        """The next bytes, which stay."""


@dataclass(frozen=True)
class Looker:
    """How files are looked at: which ``sports`` are wanted (None: any, and those of files that do not tell), by which
    ``columns`` tables are read, and up to which size."""

    sports: Collection[str] | None = ON_ROADS
    columns: Mapping[str, str] = field(default_factory=dict)
    max_bytes: int = MAX_BYTES

    def look(self, stream: IO[bytes], name: str, packed_bytes: int | None = None) -> Looked:
        """Look at an open file; raises ``OSError``. ``packed_bytes`` as ``ends_of`` takes it."""
        ends, content = ends_of(stream, self.max_bytes, packed_bytes)
        looked = self.judged(ends, content, name)
        if looked.kind is Kind.BROKEN and self._is_other_table(ends):
            return looked.as_other(Kind.NOT_A_LOG, looked.reason)
        return looked

    def judged(self, ends: Ends, content: str, name: str) -> Looked:
        """What the ends of a file tell; ``content`` is its digest."""
        told = told_by(ends)
        looked = Looked(name, Kind.DRIVE, size=ends.size, content=content, distance_m=told.distance_m)
        if ends.size >= self.max_bytes:
            return looked.as_other(Kind.TOO_LARGE, say("archive.too_large", most=self.max_bytes))
        try:
            glance = glance_at(ends, name, self.columns)
        except LogError as error:
            looked = replace(looked, sport=family(told.sport))
            return looked.as_other(kind_of(error), in_short(error))
        if ends.is_short and np.isnan(told.distance_m):
            looked = replace(looked, distance_m=along_m(glance.track[:, 1:]))
        looked = replace(looked, first_s=glance.first_s, last_s=glance.last_s, glance=thinned(glance))
        return self.of_sport(looked, told.sport)

    def _is_other_table(self, ends: Ends) -> bool:
        """Whether it is a table of something else, as its header says."""
        try:
            refuse_head(ends.head, columns=self.columns)
        except LogError:
            return True
        return False

    def of_sport(self, looked: Looked, words: str) -> Looked:
        """The same where a program calls its sport so: a drive, or not on roads. Of another kind it stays."""
        sport = family(words) or looked.sport
        if looked.kind not in (Kind.DRIVE, Kind.NOT_ON_ROADS):
            return replace(looked, sport=sport)
        is_left = bool(sport) and self.sports is not None and sport not in self.sports
        reason = say("archive.not_on_roads", sport=sport) if is_left else ""
        return replace(looked, sport=sport, reason=reason, kind=Kind.NOT_ON_ROADS if is_left else Kind.DRIVE)


def thinned(glance: Glance) -> Glance:
    """The same with a position every ``THINNED_S`` at most, and the last: thousands are held at once."""
    track = glance.track
    if len(track) < FEW_POSITIONS:
        return glance
    steps = np.floor(track[:, 0] / THINNED_S)
    kept = np.append(np.diff(steps) != 0, True)
    kept[0] = True
    return replace(glance, track=track[kept])


def told_by(ends: Ends) -> Told:
    """What a file says of its drive in so many words; nothing where no format knows it."""
    chosen = next((one for _, one in FORMATS.items() if one.recognises(ends.head)), None)
    return Told() if chosen is None else chosen.told(ends)


def kind_of(error: LogError) -> Kind:
    """What a file is that raises this when it is read."""
    kinds = {kind.value: kind for kind in Kind}
    return kinds.get(error.kind, Kind.BROKEN if isinstance(error, MalformedLogError) else Kind.UNREADABLE)
