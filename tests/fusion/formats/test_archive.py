"""Zips: members, junk, damage, bombs."""

from __future__ import annotations

import io
import zipfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import LogError, MalformedLogError
from fusion.formats import container as archive
from fusion.formats import read_log
from fusion.formats.base import Notes
from fusion.formats.container import members, shown_name


def packed(files: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """A zip of files."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as made:
        for name, data in files.items():
            made.writestr(name, data)
    return out.getvalue()


def test_members_come_without_what_systems_add() -> None:
    data = packed(
        {"a/b.rnx": b"1", "__MACOSX/a/._b.rnx": b"2", ".DS_Store": b"3", "a/": b"", "c.nav": b"4", "e": b""}
    )
    found = members(data, 100, Notes())
    assert [(m.name, m.data) for m in found] == [("b.rnx", b"1"), ("c.nav", b"4")]


@pytest.mark.parametrize(
    ("name", "shown"),
    [("../../etc/passwd", "passwd"), ("a\\b\\c.txt", "c.txt"), ("x\ny", "x?y"), ("", "unnamed")],
)
def test_names_are_for_messages_only(name: str, shown: str) -> None:
    assert shown_name(name) == shown
    assert len(shown_name("a" * 500)) <= 60


def test_more_members_or_bytes_than_allowed_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    many = packed({f"{k}.txt": b"x" for k in range(archive.MOST_MEMBERS + 1)})
    with pytest.raises(MalformedLogError, match="are read at most"):
        members(many, 10**6, Notes())
    two = packed({"a": bytes(600), "b": bytes(600)})
    assert len(members(two, 1200, Notes())) == 2
    with pytest.raises(MalformedLogError, match="unpack to less"):
        members(two, 1199, Notes())
    monkeypatch.setattr(archive, "BOMB_FREE_BYTES", 1 << 20)
    with pytest.raises(MalformedLogError, match="zip bomb"):
        members(packed({"a": bytes(3 << 20)}), 1 << 30, Notes())


def test_encrypted_and_unusual_members_are_left_out_with_a_warning() -> None:
    data = bytearray(packed({"a.txt": b"x" * 50, "b.txt": b"y" * 50}))
    for at in (6, data.index(b"PK\x01\x02") + 8):
        data[at] |= 1  # the flag of encryption
    notes = Notes()
    assert [m.name for m in members(bytes(data), 1000, notes)] == ["b.txt"]
    assert "encrypted" in notes.warnings[0]
    notes = Notes()
    assert members(packed({"a.txt": b"x"}, zipfile.ZIP_LZMA), 1000, notes) == []
    assert "unusual" in notes.warnings[0]


def test_other_documents_in_zips_and_broken_ones_are_no_archive() -> None:
    assert members(packed({"[Content_Types].xml": b"x", "word/a.xml": b"y"}), 1000, Notes()) == []
    assert members(b"PK\x03\x04" + bytes(50), 1000, Notes()) == []
    assert members(b"", 1000, Notes()) == []


def test_a_damaged_member_gives_what_comes_before(samples: dict[str, bytes]) -> None:
    data = bytearray(packed({"a.csv": samples["csv"]}, zipfile.ZIP_STORED))
    data[60 + len(samples["csv"]) // 2] ^= 1
    notes = Notes()
    assert len(members(bytes(data), 10**6, notes)) <= 1
    assert "damaged" in notes.warnings[0]


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_damaged_zips_read_or_raise_a_log_error(data: st.DataObject) -> None:
    text = b"time_s,lat_deg,lon_deg\n" + b"".join(b"%d,49,8\n" % (1525448060 + k) for k in range(30))
    sample = bytearray(packed({"a.csv": text, "b.txt": b"nothing"}))
    for _ in range(data.draw(st.integers(1, 6))):
        sample[data.draw(st.integers(0, len(sample) - 1))] = data.draw(st.integers(0, 255))
    sample = sample[: data.draw(st.integers(1, len(sample)))]
    try:
        read_log(bytes(sample))
    except LogError as error:
        assert str(error).endswith(".")
