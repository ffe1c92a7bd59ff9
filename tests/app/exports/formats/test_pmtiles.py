"""Archives of tiles, read by the library of the format's makers, whatever tiles are in them."""

from __future__ import annotations

import gzip
import random
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pmtiles.reader import MmapSource, Reader, all_tiles
from pmtiles.tile import zxy_to_tileid

from app.exports.formats import pmtiles
from app.exports.formats.pmtiles import HEADER, ROOT_ENDS_AT, tile_number, write_pmtiles
from app.exports.source import Tile

BOUNDS = (-180.0, -85.0, 180.0, 85.0)


@st.composite
def places(draw: st.DrawFn, highest: int = 15) -> Tile:
    z = draw(st.integers(0, highest))
    side = st.integers(0, 2**z - 1)
    return z, draw(side), draw(side)


def write(path: Path, tiles: dict[Tile, bytes]) -> int:
    ordered = sorted(tiles.items(), key=lambda item: tile_number(*item[0]))
    return write_pmtiles(path, ordered, metadata={"name": "x"}, zooms=(0, 15), bounds_deg=BOUNDS)


@given(place=places(24))
def test_tiles_are_numbered_along_the_curve(place: Tile) -> None:
    assert tile_number(*place) == zxy_to_tileid(*place)


@given(tiles=st.dictionaries(places(), st.sampled_from([b"a", b"b", b"a longer one"]), max_size=60))
def test_what_goes_in_comes_out(tiles: dict[Tile, bytes]) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / "tiles.pmtiles"
        assert write(path, tiles) == len(tiles)
        with path.open("rb") as file:
            source = MmapSource(file)
            reader = Reader(source)
            assert {place: gzip.decompress(data) for place, data in all_tiles(source)} == tiles
            header = reader.header()
            assert reader.metadata() == {"name": "x"}
            for (z, x, y), data in tiles.items():
                found = reader.get(z, x, y)
                assert found is not None
                assert gzip.decompress(found) == data
    assert header["addressed_tiles_count"] == len(tiles)
    assert header["tile_contents_count"] == len(set(tiles.values())), "equal tiles are there once"
    assert header["tile_entries_count"] <= len(tiles)


def test_many_tiles_have_leaves_and_a_root_that_clients_fetch_at_once(tmp_path: Path) -> None:
    draws = random.Random(1)  # noqa: S311 - any bytes will do
    tiles = {
        (8, x, y): draws.randbytes(draws.randrange(1, 60))
        for x in range(256)
        for y in range(256)
        if draws.random() < 0.3
    }
    path = tmp_path / "tiles.pmtiles"
    write(path, tiles)
    with path.open("rb") as file:
        source = MmapSource(file)
        header = Reader(source).header()
        assert {place: gzip.decompress(data) for place, data in all_tiles(source)} == tiles
    assert header["leaf_directory_length"] > 0
    assert HEADER.size + header["root_length"] <= ROOT_ENDS_AT


def test_tiles_out_of_order_are_refused(tmp_path: Path) -> None:
    tiles = [((1, 1, 1), b"a"), ((0, 0, 0), b"b")]
    with pytest.raises(ValueError, match="order"):
        write_pmtiles(tmp_path / "x", tiles, metadata={}, zooms=(0, 1), bounds_deg=BOUNDS)


def test_a_root_that_is_too_large_gets_fewer_leaves(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Leaves grow until the root fits."""
    monkeypatch.setattr(pmtiles, "ENTRIES_PER_LEAF", 2)
    tiles = {(7, x, y): f"{x}/{y}".encode() for x in range(128) for y in range(128)}
    write(tmp_path / "tiles.pmtiles", tiles)
    with (tmp_path / "tiles.pmtiles").open("rb") as file:
        source = MmapSource(file)
        assert Reader(source).header()["root_length"] <= ROOT_ENDS_AT - HEADER.size
        assert len(dict(all_tiles(source))) == len(tiles)
