"""UBX frames in a stream of bytes: found whatever stands between, across pieces, never inside one another."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.formats.receiver import ubx_frames as ubx_frame
from fusion.formats.receiver.ubx_frames import find_frames, frame


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.integers(0, 255), st.integers(0, 255), st.binary(max_size=80)), max_size=12),
    st.data(),
)
def test_every_frame_is_found_whatever_stands_between(
    messages: list[tuple[int, int, bytes]], data: st.DataObject
) -> None:
    out, start = bytearray(), []
    for cls, number, payload in messages:
        out += data.draw(st.binary(max_size=20)).replace(b"\xb5", b"\x00")
        start.append(len(out))
        out += frame(cls, number, payload)
    frames = find_frames(bytes(out))
    assert frames.start.tolist() == start
    assert frames.kind.tolist() == [c << 8 | n for c, n, _ in messages]
    assert frames.length.tolist() == [len(p) for _, _, p in messages]
    assert not len(frames.corrupt) and not len(frames.truncated)


def test_frames_across_chunk_borders_are_found(
    make: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    sample = make.drive_ubx()
    whole = find_frames(sample)
    for size in (64, 101, 4096):
        monkeypatch.setattr(ubx_frame, "CHUNK_BYTES", size)
        assert find_frames(sample).start.tolist() == whole.start.tolist()


def test_frame_and_checksum_agree_with_pyubx2(make: SimpleNamespace) -> None:
    message = make.pvt()
    assert frame(1, 7, message[6:-2]) == message


def test_a_message_within_a_payload_is_no_message(make: SimpleNamespace) -> None:
    inner = make.pvt()
    frames = find_frames(frame(0x04, 0x02, b"note " + inner) + make.att())
    assert frames.kind.tolist() == [0x0402, 0x0105]
