"""Parts of files: any range of any file gives what the standard says."""

from __future__ import annotations

import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.exports import ranges
from app.exports.ranges import NoSuchRangeError, part_of, pieces

sizes = st.integers(0, 2000)


@given(size=sizes, first=st.integers(0, 2100), length=st.none() | st.integers(0, 2100))
def test_a_range_is_a_slice(size: int, first: int, length: int | None) -> None:
    content = bytes(k % 251 for k in range(size))
    last = None if length is None else first + length
    asked = f"bytes={first}-{'' if last is None else last}"
    if first >= size:
        with pytest.raises(NoSuchRangeError):
            part_of(asked, None, '"e"', size)
        return
    part = part_of(asked, None, '"e"', size)
    assert part is not None
    expected = content[first:] if last is None else content[first : last + 1]
    assert b"".join(pieces(io.BytesIO(content), part)) == expected
    assert len(part) == len(expected)


@given(size=sizes, count=st.integers(0, 2100))
def test_the_last_bytes(size: int, count: int) -> None:
    content = bytes(k % 251 for k in range(size))
    if min(size, count) == 0:
        with pytest.raises(NoSuchRangeError):
            part_of(f"bytes=-{count}", None, '"e"', size)
        return
    part = part_of(f"bytes=-{count}", None, '"e"', size)
    assert b"".join(pieces(io.BytesIO(content), part)) == content[-count:]


@given(asked=st.text(alphabet="bytes=-0123456789, ", max_size=20), size=sizes)
def test_no_header_is_a_fault(asked: str, size: int) -> None:
    try:
        part = part_of(asked, None, '"e"', size)
    except NoSuchRangeError:
        return
    assert part is None or 0 <= part[0] <= part[-1] < size


def test_large_parts_come_in_pieces_and_close_the_file(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranges, "CHUNK_BYTES", 3)
    file = io.BytesIO(b"0123456789")
    assert list(pieces(file, range(1, 9))) == [b"123", b"456", b"78"]
    assert file.closed
