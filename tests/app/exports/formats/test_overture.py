"""The join with Overture's segments by a bridge file, made here as Overture makes it: ranges by geodesic lengths."""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from pyproj import Geod
from typer.testing import CliRunner

from app.cli import app
from app.exports.formats import FORMATS
from app.exports.source import Query, Source
from app.exports.writing.gers import read_bridge
from fusion.errors import BadOptionsError
from fusion.simulate.scene.segments import Way
from fusion.simulate.scene.town import Town

Mapped = Any  # of conftest, which cannot be imported
Row = dict[str, str]
WGS84 = Geod(ellps="WGS84")
SCHEMA = pa.schema(
    {
        "id": pa.string(),
        "record_id": pa.string(),
        "dataset": pa.string(),
        "type": pa.string(),
        "between": pa.list_(pa.float64()),
        "dataset_between": pa.list_(pa.float64()),
    }
)


def record(gers: str, way: int, on_gers: Any = None, on_way: Any = None, version: int = 1) -> dict[str, Any]:
    return {
        "id": gers,
        "record_id": f"w{way}@{version}",
        "dataset": "OpenStreetMap",
        "type": "segment",
        "between": on_gers,
        "dataset_between": on_way,
    }


def write_bridge(path: Path, records: Sequence[dict[str, Any]]) -> Path:
    pq.write_table(pa.Table.from_pylist(list(records), schema=SCHEMA), path)
    return path


def metres(town: Town, nodes: Sequence[int]) -> np.ndarray[Any, Any]:
    """From the first of the nodes to each."""
    lon, lat = (np.round(one[list(nodes)], 7) for one in (town.node_lon_deg, town.node_lat_deg))
    return np.concatenate([[0.0], np.cumsum(WGS84.inv(lon[:-1], lat[:-1], lon[1:], lat[1:])[2])])


def rows_of(path: Path) -> list[Row]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def is_line(way: Way) -> bool:
    return len(set(way.nodes)) == len(way.nodes)


@pytest.fixture(scope="module")
def split(mapped: Mapped, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[int, int]]:
    """A bridge file in which every third way is cut at its middle node, and by such a way that node's place in it."""
    records, cut = [], {}
    for number, way in zip(count(), mapped.town.ways, strict=False):
        if number % 3 or len(way.nodes) < 3 or not is_line(way):
            records.append(record(f"whole-{way.way_id}", way.way_id, [0.0, 1.0], [0.0, 1.0]))
            continue
        k = cut[way.way_id] = len(way.nodes) // 2
        along = metres(mapped.town, way.nodes)
        at = round(float(along[k] / along[-1]), 9)
        records += [
            record(f"{name}-{way.way_id}", way.way_id, None, on_way)
            for name, on_way in (("front", [0.0, at]), ("back", [at, 1.0]))
        ]
    others = [record("a-building", mapped.town.ways[0].way_id) | {"type": "building"}]
    others += [record("a-node", 5) | {"record_id": "n5@1"}, record("elsewhere", 77)]
    assert len(cut) > 5
    folder = tmp_path_factory.mktemp("bridge")
    write_bridge(folder / "one.parquet", records[::2])
    write_bridge(folder / "two.parquet", records[1::2] + others)
    return folder, cut


def test_segments_of_a_way_that_is_cut_are_told_apart(
    mapped: Mapped, split: tuple[Path, dict[int, int]], tmp_path: Path
) -> None:
    folder, cut = split
    n, notes = mapped.write("overture", tmp_path / "joined.csv", bridge=str(folder))
    rows = rows_of(tmp_path / "joined.csv")
    with mapped.source() as source:
        segments = {str(one.id): one for one in source.segments(gaps=True)}
    assert [row["segment_id"] for row in rows] == list(segments), "each segment once, whole, in order"
    assert n == len(rows) and notes == []
    node_of = {way.way_id: [int(mapped.town.node_id[k]) for k in way.nodes] for way in mapped.town.ways}
    for row in rows:
        segment = segments[row["segment_id"]]
        way = segment.osm_way_id
        kind = "whole"
        if way in cut:
            kind = "front" if node_of[way].index(segment.from_node) < cut[way] else "back"
        assert row["gers_id"] == f"{kind}-{way}"
        assert (row["candidates"], row["direction"]) == ("1", "1")
        assert float(row["length_m"]) == pytest.approx(segment.length_m, abs=1e-3)
        slope = segment.slope_percent
        assert row["slope_percent"] == ("" if slope is None else str(round(slope, 4)))
        low, high = float(row["gers_from"]), float(row["gers_to"])
        assert 0 <= low < high <= 1
        if kind == "whole":
            assert (low, high) == (float(row["way_from"]), float(row["way_to"]))
    whole = [sum(float(r["gers_to"]) - float(r["gers_from"]) for r in rows if r["gers_id"] == name)
             for name in sorted({r["gers_id"] for r in rows})]  # fmt: skip
    assert whole == pytest.approx([1.0] * len(whole), abs=1e-6), "the segments cover each Overture segment"


def test_a_box_changes_which_rows_there_are_and_nothing_in_them(
    mapped: Mapped, split: tuple[Path, dict[int, int]], tmp_path: Path
) -> None:
    town = mapped.town
    west, south = float(town.node_lon_deg.min()), float(town.node_lat_deg.min())
    box = (west, south, float(np.median(town.node_lon_deg)), float(np.median(town.node_lat_deg)))
    few, _ = mapped.write("overture", tmp_path / "box.csv", bbox=box, bridge=str(split[0]))
    all_of_them, _ = mapped.write("overture", tmp_path / "all.csv", bridge=str(split[0]))
    assert 20 < few < all_of_them - 20
    every = {row["segment_id"]: row for row in rows_of(tmp_path / "all.csv")}
    assert all(every[row["segment_id"]] == row for row in rows_of(tmp_path / "box.csv"))


def test_parquet_has_the_same_rows_with_types(
    mapped: Mapped, split: tuple[Path, dict[int, int]], tmp_path: Path
) -> None:
    for suffix in ("csv", "parquet"):
        mapped.write("overture", tmp_path / f"joined.{suffix}", bridge=str(split[0]))
    table = pq.read_table(tmp_path / "joined.parquet")
    assert table.schema.field("segment_id").type == pa.int64()
    assert (
        "© OpenStreetMap contributors".encode()
        in pq.read_metadata(tmp_path / "joined.parquet").metadata[b"attribution"]
    )
    texts = [["" if v is None else str(v) for v in row.values()] for row in table.to_pylist()]
    assert texts == [list(row.values()) for row in rows_of(tmp_path / "joined.csv")]


def meeting(town: Town) -> tuple[Way, Way]:
    """Two ways that end in the same node: who goes along both goes along one of them backwards."""
    lines = [way for way in town.ways if is_line(way)]
    return next(
        (a, b) for a in lines for b in lines
        if a.way_id < b.way_id and len({*a.nodes} | {*b.nodes}) == len(a.nodes) + len(b.nodes) - 1
        and a.nodes[-1] == b.nodes[-1]
    )  # fmt: skip


def test_of_several_ways_the_nodes_between_them_tell_the_direction(mapped: Mapped, tmp_path: Path) -> None:
    there, back = meeting(mapped.town)
    lengths = [metres(mapped.town, way.nodes)[-1] for way in (there, back)]
    at = float(lengths[0] / sum(lengths))
    bridge = write_bridge(
        tmp_path / "b.parquet",
        [
            record("both", there.way_id, [0.0, at], [0.0, 1.0]),
            record("both", back.way_id, [at, 1.0], [0.0, 1.0]),
        ],
    )
    mapped.write("overture", tmp_path / "joined.csv", bridge=str(bridge))
    rows = [row for row in rows_of(tmp_path / "joined.csv") if row["gers_id"]]
    assert {(row["osm_way_id"], row["direction"]) for row in rows} == {
        (str(there.way_id), "1"),
        (str(back.way_id), "-1"),
    }
    rows.sort(key=lambda row: float(row["gers_from"]))
    edges = [0.0, *(float(row["gers_to"]) for row in rows)]
    assert [float(row["gers_from"]) for row in rows] == pytest.approx(edges[:-1], abs=1e-8)
    assert edges[-1] == 1.0
    with mapped.source() as source:
        segments = {str(one.id): one for one in source.segments(gaps=True)}
    course = [segments[row["segment_id"]] for row in rows]
    assert course[-1].from_node == mapped.town.node_id[back.nodes[0]], "it ends where the second way begins"


def test_a_part_whose_neighbours_are_not_here_has_no_direction(mapped: Mapped, tmp_path: Path) -> None:
    way = mapped.town.ways[0]
    records = [record("more", way.way_id, [0.2, 1.0], [0.0, 1.0]), record("more", 77, [0.0, 0.2], [0.0, 1.0])]
    bridge = write_bridge(tmp_path / "b.parquet", records)
    _, notes = mapped.write("overture", tmp_path / "joined.csv", bridge=str(bridge))
    rows = [row for row in rows_of(tmp_path / "joined.csv") if row["gers_id"]]
    assert len(rows) == len(way.nodes) - 1
    assert {(row["direction"], row["gers_from"], row["candidates"]) for row in rows} == {("", "", "1")}
    assert f"Of {len(rows)} rows it is not known how" in notes[-1]


def test_without_ranges_a_segment_stands_beside_every_candidate(mapped: Mapped, tmp_path: Path) -> None:
    one, two = (way for way in mapped.town.ways[:2])
    told = [record("a", one.way_id), record("b", one.way_id), record("c", two.way_id, version=4)]
    names = ["id", "record_id"]
    for number, records in enumerate(([{k: r[k] for k in names} for r in told], told)):
        bridge = tmp_path / f"{number}.parquet"
        pq.write_table(pa.Table.from_pylist(records, schema=SCHEMA if number else None), bridge)
        n, notes = mapped.write("overture", tmp_path / "joined.csv", bridge=str(bridge))
        rows = rows_of(tmp_path / "joined.csv")
        assert n == len(rows)
        of_one = [row for row in rows if row["osm_way_id"] == str(one.way_id)]
        assert len(of_one) == 2 * (len(one.nodes) - 1)
        assert {(row["gers_id"], row["candidates"], row["gers_from"]) for row in of_one} == {
            ("a", "2", ""),
            ("b", "2", ""),
        }
        of_two = [row for row in rows if row["osm_way_id"] == str(two.way_id)]
        assert {(row["gers_id"], row["candidates"], row["direction"]) for row in of_two} == {("c", "1", "1")}
        ways = len(mapped.town.ways)
        assert f"Of {ways - 2} of {ways} ways the bridge file knows nothing" in notes[0]
        assert f"Of 1 of {ways} ways the bridge file and the roads have different versions" in notes[1]
        assert f"Of 1 of {ways} ways it is not known where" in notes[2]


def test_without_a_bridge_file_rows_are_places_along_ways(mapped: Mapped, tmp_path: Path) -> None:
    n, notes = mapped.write("overture", tmp_path / "places.csv")
    rows = rows_of(tmp_path / "places.csv")
    assert len(rows) == n and all(row["gers_id"] == row["direction"] == "" for row in rows)
    assert len(notes) == 1 and "Without bridge=FILE" in notes[0]
    for way in filter(is_line, mapped.town.ways):
        along = metres(mapped.town, way.nodes)
        found = sorted(float(row["way_from"]) for row in rows if row["osm_way_id"] == str(way.way_id))
        assert found == pytest.approx((along[:-1] / along[-1]).tolist(), abs=2e-3)


def test_what_is_no_bridge_file_is_told(mapped: Mapped, tmp_path: Path) -> None:
    ways = np.array([1])
    (tmp_path / "text.parquet").write_text("no Parquet")
    pq.write_table(pa.table({"id": ["a"], "way": [1]}), tmp_path / "other.parquet")
    for name, says in (
        ("none.parquet", "cannot be read"),
        ("text.parquet", "cannot be read"),
        ("other.parquet", "other.parquet has no column record_id"),
    ):
        with pytest.raises(BadOptionsError, match=says) as told:
            read_bridge(tmp_path / name, ways)
        assert told.value.where == "bridge"
    assert FORMATS["overture"].parse_options({}, local=False)


def test_narrower_exports_are_taken(mapped: Mapped, tmp_path: Path) -> None:
    form = FORMATS["overture"]
    with mapped.sessions() as session:
        source = Source(session, mapped.place, Query(driven=True))
        count = form.write(source, tmp_path / "d.csv", {}, form.parse_options({}, local=True))
    rows = rows_of(tmp_path / "d.csv")
    assert count == len(rows) > 10 and all(int(row["drives"]) > 0 for row in rows)


def test_the_command_takes_a_folder_of_a_release(
    mapped: Mapped, split: tuple[Path, dict[int, int]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a release has it, whose folders' names hold an equals sign and say what is not in the files."""
    folder = tmp_path / "theme=transportation" / "type=segment"
    folder.mkdir(parents=True)
    for path in sorted(split[0].iterdir()):
        pq.write_table(pq.read_table(path).drop_columns(["type"]), folder / path.name)
    with mapped.sessions() as session:
        monkeypatch.setenv(
            "VERSANT_DATABASE_URL", session.get_bind().url.render_as_string(hide_password=False)
        )
    monkeypatch.setenv("VERSANT_DATA_DIR", str(mapped.place.parent))
    out = tmp_path / "slopes.parquet"
    done = CliRunner().invoke(
        app, ["export", "--as", "overture", "-o", str(out), "--option", f"bridge={folder}"]
    )
    assert done.exit_code == 0, done.output
    rows = pq.read_table(out).num_rows
    assert f"{rows} rows" in done.output
    request = json.loads(pq.read_metadata(out).metadata[b"provenance"])["request"]
    assert request["options"] == {"bridge": "type=segment"}, "the name alone, no path of this machine"
