"""Small files of roads that unpack to gigabytes, or grow while they are read."""

from __future__ import annotations

import gzip
import struct
import zlib
from pathlib import Path

import pytest

from fusion.errors import RoadsError
from fusion.roads.osm import read_roads
from fusion.roads.osm_changes import apply_changes, keep_roads

MIB = 1 << 20


def field(number: int, content: bytes | int) -> bytes:
    """A field of a protocol buffer."""
    if isinstance(content, int):
        return varint(number << 3) + varint(content)
    return varint(number << 3 | 2) + varint(len(content)) + content


def varint(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def blob(kind: bytes, content: bytes) -> bytes:
    packed = field(2, len(content)) + field(3, zlib.compress(content, 9))
    header = field(1, kind) + field(3, len(packed))
    return struct.pack(">I", len(header)) + header + packed


def pbf_bomb(path: Path, mib: int) -> Path:
    """Nodes that are all alike: a thousandth of their size."""
    header = blob(b"OSMHeader", field(4, b"OsmSchema-V0.6") + field(4, b"DenseNodes"))
    count = 4 * MIB
    dense = field(1, b"\x02" * count) + field(8, b"\x02" * count) + field(9, b"\x02" * count)
    block = blob(b"OSMData", field(1, field(1, b"")) + field(2, field(2, dense)))
    path.write_bytes(header + block * (mib // 12))
    return path


def gzip_bomb(path: Path, mib: int, root: str = "osm") -> Path:
    with gzip.open(path, "wb") as file:
        file.write(f'<{root} version="0.6">'.encode())
        for _ in range(mib):
            file.write(b" " * MIB)
        file.write(f"</{root}>".encode())
    return path


def test_a_pbf_that_unpacks_to_gigabytes_is_refused_by_its_headers(tmp_path: Path) -> None:
    path = pbf_bomb(tmp_path / "a.osm.pbf", 1200)
    assert path.stat().st_size < 3 * MIB
    for read in (read_roads, lambda source: keep_roads(source, tmp_path / "kept.osm.pbf")):
        with pytest.raises(RoadsError, match="unpacks to"):
            read(path)


def test_a_gzip_that_unpacks_to_gigabytes_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = gzip_bomb(tmp_path / "a.osm.gz", 100)
    with pytest.raises(RoadsError, match="unpacks to"):
        read_roads(path)
    changes = gzip_bomb(tmp_path / "a.osc.gz", 100, "osmChange")
    (tmp_path / "kept.osm").write_text('<osm version="0.6"></osm>')
    with pytest.raises(RoadsError, match="unpacks to"):
        apply_changes(tmp_path / "kept.osm", changes, tmp_path / "new.osm.pbf", (0, 0, 1, 1))


@pytest.mark.parametrize(
    "content", [b"\x00\x00\x00\x0d\x0a\x09OSMHeader\x18\xff\xff\xff\xff\x0f", b"\xff\xff\xff\xffOSMHeader"]
)
def test_headers_that_lie_are_damage(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.osm.pbf").write_bytes(content)
    with pytest.raises(RoadsError, match="is damaged"):
        read_roads(tmp_path / "a.osm.pbf")


@pytest.mark.parametrize(
    "entity", ['<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;">', '<!ENTITY b SYSTEM "file:///etc/passwd">']
)
def test_entities_are_refused(tmp_path: Path, entity: str) -> None:
    (tmp_path / "a.osm").write_text(
        f'<?xml version="1.0"?><!DOCTYPE osm [{entity}]><osm version="0.6"><node id="1" lat="49" lon="8">'
        '<tag k="name" v="&b;"/></node></osm>'
    )
    with pytest.raises(RoadsError, match="entities are not supported"):
        read_roads(tmp_path / "a.osm")


def test_several_gzips_in_a_row_are_one_file_and_what_follows_is_passed_over(tmp_path: Path) -> None:
    nodes = b'<node id="1" lat="49" lon="8"/><node id="2" lat="49.001" lon="8"/>'
    way = b'<way id="3"><nd ref="1"/><nd ref="2"/><tag k="highway" v="road"/></way></osm>'
    parts = gzip.compress(b'<osm version="0.6">' + nodes) + gzip.compress(way)
    for rest in (b"", b"\x00" * 512):
        (tmp_path / "a.osm.gz").write_bytes(parts + rest)
        assert len(read_roads(tmp_path / "a.osm.gz")) == 1


@pytest.mark.parametrize("numbers", [(-1, 2, 3), (1, 2, -3), (1, -2, 3), (2**52, 2, 3), (1, 2, 2**60)])
def test_numbers_of_an_editor_s_unsaved_edits_are_refused_with_a_sentence(
    tmp_path: Path, numbers: tuple[int, int, int]
) -> None:
    a, b, way = numbers
    things = (
        f'<node id="{a}" version="2" lat="49" lon="8"/><node id="{b}" version="2" lat="49.001" lon="8"/>'
        f'<way id="{way}" version="2"><nd ref="{a}"/><nd ref="{b}"/><tag k="highway" v="road"/></way>'
    )
    (tmp_path / "kept.osm").write_text('<osm version="0.6"></osm>')
    (tmp_path / "a.osc").write_text(f'<osmChange version="0.6"><create>{things}</create></osmChange>')
    with pytest.raises(RoadsError, match="is damaged"):
        apply_changes(tmp_path / "kept.osm", tmp_path / "a.osc", tmp_path / "new.osm.pbf", (0, 0, 90, 90))
