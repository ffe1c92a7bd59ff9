"""The frames of the UBX protocol: sync bytes b5 62, class, id, length, payload, two checksum bytes.

Source: u-blox 8 / M8 receiver description, "UBX protocol", and spec 1 section 9.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.formats.base import Data
from fusion.types import Bools, Ints, Progress, no_progress

SYNC = b"\xb5\x62"
OVERHEAD_BYTES = 8
MAX_FRAME_BYTES = 65535 + OVERHEAD_BYTES
CHUNK_BYTES = 16 << 20


@dataclass(frozen=True)
class Frames:
    """The intact UBX messages of a byte stream, in order and without overlap.

    ``start`` is the offset of the first sync byte, ``length`` the payload's length in bytes, ``kind`` is
    256 * class + id. ``corrupt`` and ``truncated`` hold the offsets of sync bytes whose frame is not intact.
    """

    start: Ints
    length: Ints
    kind: Ints
    corrupt: Ints
    truncated: Ints

    def __len__(self) -> int:
        return len(self.start)

    @property
    def end(self) -> Ints:
        """Offset just past each frame."""
        return self.start + self.length + OVERHEAD_BYTES


def frame(cls: int, msg_id: int, payload: bytes) -> bytes:
    """One UBX message, ready to write."""
    body = bytes([cls, msg_id]) + len(payload).to_bytes(2, "little") + payload
    return SYNC + body + fletcher(body)


def fletcher(body: bytes) -> bytes:
    """The 8-bit Fletcher checksum over class, id, length and payload."""
    a = b = 0
    for value in body:
        a = (a + value) & 255
        b = (b + a) & 255
    return bytes([a, b])


def find_frames(data: Data, progress: Progress = no_progress) -> Frames:
    """Find every intact frame, whatever lies between; resynchronises after corrupt bytes by itself.

    Each occurrence of the sync bytes is tried at once: both Fletcher sums of any stretch follow from two
    running sums, s1 = sum(x) and s2 = sum(i x), modulo 256: a = s1(end) - s1(start), b = end * a - (s2(end)
    - s2(start)).
    """
    buf = np.frombuffer(data, np.uint8)
    pieces: list[tuple[Ints, Ints, NDArray[np.int8]]] = []
    size = max(len(buf), 1)
    for at in range(0, size, CHUNK_BYTES):
        piece = buf[at : at + CHUNK_BYTES + MAX_FRAME_BYTES]
        start, length, state = _try_candidates(piece, CHUNK_BYTES)
        pieces.append((start + at, length, state))
        progress("find messages", min(1.0, (at + CHUNK_BYTES) / size))
    start, length, state = (np.concatenate(c) for c in zip(*pieces, strict=True))
    return _without_overlap(buf, start, length, state)


def _try_candidates(piece: NDArray[np.uint8], limit: int) -> tuple[Ints, Ints, NDArray[np.int8]]:
    """Offset and payload length of all sync bytes before ``limit``; state 1 intact, 0 corrupt, -1 cut off."""
    start = np.flatnonzero((piece[:-1] == SYNC[0]) & (piece[1:] == SYNC[1]))
    start = start[start < limit]
    length = np.full(len(start), -1, np.int64)
    complete = start + 6 <= len(piece)
    at = start[complete]
    length[complete] = piece[at + 4].astype(np.int64) | piece[at + 5].astype(np.int64) << 8
    state = np.full(len(start), -1, np.int8)
    inside = complete & (start + length + OVERHEAD_BYTES <= len(piece))
    if inside.any():
        first, last = start[inside] + 2, start[inside] + 6 + length[inside]
        s1 = np.concatenate([np.zeros(1, np.uint8), np.cumsum(piece, dtype=np.uint8)])
        weighted = piece * np.arange(len(piece), dtype=np.int64).astype(np.uint8)
        s2 = np.concatenate([np.zeros(1, np.uint8), np.cumsum(weighted, dtype=np.uint8)])
        a = s1[last] - s1[first]
        b = last.astype(np.uint8) * a - (s2[last] - s2[first])
        state[inside] = (a == piece[last]) & (b == piece[last + 1])
    return start.astype(np.int64), length, state


def _without_overlap(buf: NDArray[np.uint8], start: Ints, length: Ints, state: NDArray[np.int8]) -> Frames:
    good = state == 1
    s, n = start[good], length[good]
    e = s + n + OVERHEAD_BYTES
    if np.any(s[1:] < e[:-1]):
        keep = _first_come(s, e)
        s, n, e = s[keep], n[keep], e[keep]
    bad_start, bad_state = start[~good], state[~good]
    ends = np.append(0, e)  # 0: where no intact message comes before
    # sync bytes within an intact message are its payload, no message of their own
    free = bad_start >= ends[np.searchsorted(s, bad_start, side="right")]
    # a corrupt length points past the end anywhere in a file; only after the last intact one is it a cut
    cut = free & (bad_state == -1) & (bad_start >= ends[-1])
    corrupt, truncated = bad_start[free & ~cut], bad_start[cut]
    kind = buf[s + 2].astype(np.int64) << 8 | buf[s + 3].astype(np.int64)
    return Frames(s, n, kind, corrupt, truncated)


def _first_come(start: Ints, end: Ints) -> Bools:
    keep = np.zeros(len(start), bool)
    free_from = 0
    for i, (s, e) in enumerate(zip(start.tolist(), end.tolist(), strict=True)):
        if s >= free_from:
            keep[i] = True
            free_from = e
    return keep


def without_frames(data: Data, frames: Frames) -> bytes:
    """The stream with every intact frame blanked by line feeds: what is left is text, at its old offsets."""
    if not len(frames):
        return bytes(data)
    buf = np.frombuffer(data, np.uint8).copy()
    edge = np.zeros(len(buf) + 1, np.int8)
    edge[frames.start] += 1
    np.subtract.at(edge, frames.end, 1)
    buf[np.cumsum(edge[:-1], dtype=np.int8) > 0] = 10
    return buf.tobytes()
