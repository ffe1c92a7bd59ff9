"""What uploads unpack to, told while they stream by."""

from __future__ import annotations

import gzip
import hashlib
import os
import tracemalloc
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.core.content import ContentHash

LOG = b"time_s,lat_deg,lon_deg\n" + b"".join(b"%d,49.0,8.4\n" % k for k in range(3000))
MAX_BYTES = 512 << 20


def content_of(data: bytes, piece: int = 1 << 20, max_bytes: int = MAX_BYTES) -> str:
    told = ContentHash(max_bytes)
    for start in range(0, len(data), piece):
        told.update(data[start : start + piece])
    assert told.sha256() == sha256(data)
    return told.content_sha256()


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def named(data: bytes, name: bytes) -> bytes:
    """A gzip whose header has the file's name."""
    plain = gzip.compress(data)
    return plain[:3] + b"\x08" + plain[4:10] + name + b"\0" + plain[10:]


FORMS = {
    "plain": LOG,
    "level 1": gzip.compress(LOG, 1),
    "level 9, another time": gzip.compress(LOG, 9, mtime=1),
    "with a name": named(LOG, b"monday.csv"),
    "two members": gzip.compress(LOG[:1000]) + gzip.compress(LOG[1000:]),
    "gzipped twice": gzip.compress(gzip.compress(LOG)),
    "with something behind": gzip.compress(LOG) + b"\0\0\0",
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("piece", [1, 7, 1 << 20])
def test_a_log_is_the_same_in_every_form_and_in_pieces_of_any_size(form: str, piece: int) -> None:
    assert content_of(FORMS[form], piece) == sha256(LOG)


BROKEN = {
    "cut by a byte": gzip.compress(LOG)[:-1],
    "cut": gzip.compress(LOG)[:500],
    "wrong checksum": gzip.compress(LOG)[:-8] + bytes(8),
    "second member cut": gzip.compress(LOG) + gzip.compress(LOG)[:20],
    "no gzip": b"\x1f\x8b not a gzip",
    "half a magic": b"\x1f",
    "a magic": b"\x1f\x8b",
}


@pytest.mark.parametrize("broken", BROKEN.values(), ids=BROKEN)
def test_a_broken_gzip_is_its_own_content(broken: bytes) -> None:
    assert content_of(broken) == content_of(broken, 1) == sha256(broken)


def test_a_gzip_with_a_broken_one_inside_is_that() -> None:
    broken = gzip.compress(LOG)[:-1]
    assert content_of(gzip.compress(broken)) == sha256(broken)


@given(st.binary(), st.lists(st.integers(1, 50)), st.integers(1, 9))
def test_any_bytes_gzipped_are_the_bytes(data: bytes, cuts: list[int], level: int) -> None:
    packed = gzip.compress(data, level)
    told = ContentHash(MAX_BYTES)
    for cut in cuts:
        told.update(packed[:cut])
        packed = packed[cut:]
    told.update(packed)
    assert told.content_sha256() == content_of(data)


def test_what_unpacks_to_more_than_allowed_is_its_own_content() -> None:
    packed = gzip.compress(LOG)
    assert content_of(packed, max_bytes=len(LOG)) == sha256(LOG)
    assert content_of(packed, max_bytes=len(LOG) - 1) == sha256(packed)


def test_a_bomb_is_let_be_after_a_part_of_it_in_little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    bomb = gzip.compress(bytes(160 << 20), 1)
    given_back = 0
    genuine = zlib.decompressobj

    class Counting:
        def __init__(self, wbits: int) -> None:
            self.member = genuine(wbits)

        def __getattr__(self, name: str) -> object:
            return getattr(self.member, name)

        def decompress(self, data: bytes, most: int) -> bytes:
            nonlocal given_back
            piece = self.member.decompress(data, most)
            given_back += len(piece)
            return piece

    monkeypatch.setattr("app.core.content.zlib.decompressobj", Counting)
    tracemalloc.start()
    try:
        assert content_of(bomb) == sha256(bomb)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert given_back < 70 << 20
    assert peak < 16 << 20


def test_a_long_log_takes_little_memory() -> None:
    packed = gzip.compress(os.urandom(1 << 20) * 16, 1)
    tracemalloc.start()
    try:
        content_of(packed)
        assert tracemalloc.get_traced_memory()[1] < 8 << 20
    finally:
        tracemalloc.stop()
