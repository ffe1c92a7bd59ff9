"""Proposals of ``incline``: what counts as steep, what is left in peace, and the files for people to review."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import defusedxml.ElementTree
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from app.exports.formats.josm import layer_ways, pieces
from app.exports.formats.maproulette import task as task_of
from app.exports.writing.inclines import (
    STEEPEST_M,
    InclineOptions,
    Section,
    conflicts,
    sections,
    steepest_percent,
    tagged_percent,
    worth_telling,
)
from app.exports.writing.osm_files import OsmNode, OsmWay
from app.map.segment import Segment

Mapped = Any  # of conftest, which cannot be imported
USUAL = InclineOptions()
SEGMENT = Segment(
    id=1, osm_way_id=7, from_node=0, to_node=1, length_m=50.0, highway="residential", name=None, oneway=0,
    bridge=False, tunnel=False, slope_percent=0.0, slope_sigma_percent=0.3, drives=3, observations=9,
    dem_slope_percent=None, updated_at=None, coordinates=((8.0, 49.0), (8.1, 49.1)), driven_share=1.0,
)  # fmt: skip


def line(
    *slopes: float | None, length_m: float = 50.0, **changes: Any
) -> dict[tuple[int, int, int], Segment]:
    """What was measured of a way of segments with these slopes; None: nothing."""
    return {
        (7, k, k + 1): replace(
            SEGMENT, from_node=k, to_node=k + 1, slope_percent=slope, length_m=length_m, **changes
        )
        for k, slope in enumerate(slopes)
        if slope is not None
    }


def way(segments: int, **tags: str) -> OsmWay:
    return OsmWay(7, 3, tuple(range(segments + 1)), {"highway": "residential", **tags})


def found(*slopes: float | None, options: InclineOptions = USUAL, **changes: Any) -> list[Section]:
    return list(sections(way(len(slopes)), line(*slopes, **changes), options))


def test_a_section_is_a_run_of_one_sign_and_its_value_the_steepest_part() -> None:
    (up, down) = found(1.0, 6.0, 9.0, 7.0, 1.0, -6.0, -8.0, 0.5)
    assert (up.first, up.last, up.percent, up.whole) == (1, 4, 9, False)
    assert (up.from_node, up.to_node, up.length_m) == (1, 4, 150.0)
    assert up.mean_percent == pytest.approx(22 / 3) and up.drives == 3
    assert (down.first, down.last, down.value) == (5, 7, "-8%")
    assert up.open_ends == down.open_ends == (False, False)


def test_a_way_that_is_steep_throughout_is_not_split() -> None:
    (section,) = found(6.0, 8.0, 7.0)
    assert section.whole and section.value == "8%"
    assert "on the whole way" in section.describe()
    (nearly,) = found(1.0, 60.0, 62.0, length_m=25.0)
    assert nearly.whole  # what is left is shorter than any section


def test_where_nothing_was_measured_a_section_ends_and_says_so() -> None:
    (section,) = found(6.0, 8.0, None, 7.0)[:1]
    assert (section.first, section.last, section.open_ends, section.whole) == (0, 2, (False, True), False)
    assert "Beyond node 2 nothing was measured" in section.describe()


def test_a_short_dip_does_not_end_a_section_and_a_turn_of_sign_does() -> None:
    dip = line(8.0, 8.0, 3.0, 8.0, 8.0) | {(7, 2, 3): replace(line(3.0)[7, 0, 1], length_m=15.0)}
    assert [(s.first, s.last) for s in sections(way(5), dip, USUAL)] == [(0, 5)]
    turn = dip | {(7, 2, 3): replace(line(-1.0)[7, 0, 1], length_m=15.0)}
    assert [(s.first, s.last) for s in sections(way(5), turn, USUAL)] == [(0, 2), (3, 5)]
    assert [(s.first, s.last) for s in found(8.0, 3.0, 8.0)] == [(0, 1), (2, 3)]


@pytest.mark.parametrize(
    "changes",
    [{"slope_sigma_percent": 2.5}, {"drives": 1}, {"length_m": 12.0}, {"driven_share": 0.5}],
)
def test_what_is_in_doubt_is_not_told(changes: dict[str, Any]) -> None:
    assert found(7.0, 7.0) and not found(7.0, 7.0, **changes)


def test_the_options_say_what_is_beyond_doubt() -> None:
    assert not found(7.0, options=InclineOptions(min_percent=8))
    assert not found(7.0, options=InclineOptions(z=30))
    assert found(7.0, drives=1, options=InclineOptions(min_drives=1))
    assert not found(7.0, options=InclineOptions(min_length_m=60))


@example([20.0, 5.0, 20.0], 10.0)
@given(st.lists(st.floats(-20, 20), min_size=1, max_size=12), st.floats(1, 60))
def test_sections_lie_apart_and_are_steep_in_their_mean(slopes: list[float], length_m: float) -> None:
    line_of_sections = found(*slopes, length_m=length_m)
    for section in line_of_sections:
        assert section.mean_percent * section.percent > 0
        assert 0 <= section.first < section.last <= len(slopes)
        # So many stretches of 20 m cover the section, overlapping: one of them has at least its share of the rise.
        covering_m = STEEPEST_M * math.ceil(section.length_m / STEEPEST_M - 1e-9)
        least_percent = abs(section.mean_percent) * section.length_m / covering_m
        assert abs(section.percent) >= math.floor(least_percent - 1e-9)
        inside = slopes[section.first : section.last]
        assert abs(section.percent) <= round(max(abs(s) for s in inside)) + 1
    assert all(a.last <= b.first for a, b in pairwise(line_of_sections))


def test_turned_round_a_way_has_the_same_sections_with_turned_signs() -> None:
    slopes = (1.0, 6.0, 9.0, 7.0, 1.0, -6.0, -8.0, 0.5)
    there = found(*slopes)
    back = found(*(-s for s in reversed(slopes)))
    assert [(8 - s.last, 8 - s.first, -s.percent) for s in reversed(back)] == [
        (s.first, s.last, s.percent) for s in there
    ]


def test_the_steepest_20_m_are_those_that_are_steep_for_sure() -> None:
    flat, steep = replace(SEGMENT, slope_percent=6.0), replace(SEGMENT, slope_percent=10.0, length_m=30.0)
    assert steepest_percent([flat, steep], 1) == pytest.approx((10.0, 0.3))
    short = replace(SEGMENT, slope_percent=10.0, length_m=10.0)
    assert steepest_percent([flat, short, flat], 1)[0] == pytest.approx(8.0)
    doubtful = replace(SEGMENT, slope_percent=14.0, length_m=20.0, slope_sigma_percent=9.0)
    assert steepest_percent([flat, doubtful, flat], 1)[0] < 8.0
    inside = replace(flat, steepest_percent=11.0)
    assert steepest_percent([inside], 1)[0] == 11.0
    assert steepest_percent([replace(flat, steepest_percent=-2.0)], 1)[0] == 6.0
    assert steepest_percent([replace(flat, slope_percent=-6.0)], -1)[0] == -6.0


@pytest.mark.parametrize(
    ("tag", "percent"),
    [
        ("10%", 10),
        ("-7.5 %", -7.5),
        ("8", 8),
        ("+12%", 12),
        ("45°", 100),
        ("7,5%", 7.5),
        ("up", None),
        ("steep", None),
    ],
)
def test_values_of_incline_as_people_write_them(tag: str, percent: float | None) -> None:
    assert tagged_percent(tag) == (None if percent is None else pytest.approx(percent))


def test_what_is_in_conflict() -> None:
    assert not conflicts("10%", 12, 3) and conflicts("10%", 14, 3) and conflicts("-10%", 10, 3)
    assert not conflicts("up", 9, 3) and conflicts("down", 9, 3) and conflicts("steep", 9, 3)


# RFC 7464, and MapRoulette's tag fixes.

TASK = re.compile("\x1e([^\x1e\n]*)\n")


def tasks_checked(path: Path) -> list[dict[str, Any]]:
    text = path.read_bytes().decode("utf-8")
    assert "".join(f"\x1e{body}\n" for body in TASK.findall(text)) == text
    tasks = [json.loads(body) for body in TASK.findall(text)]
    for task in tasks:
        assert task["type"] == "FeatureCollection" and len(task["features"]) == 1
        feature = task["features"][0]
        assert feature["type"] == "Feature" and feature["geometry"]["type"] == "LineString"
        assert len(feature["geometry"]["coordinates"]) >= 2
        assert "OpenStreetMap contributors" in feature["properties"]["attribution"]
        if "cooperativeWork" in task:
            work = task["cooperativeWork"]
            assert work["meta"] == {"version": 2, "type": 1}
            (operation,) = work["operations"]
            assert operation["operationType"] == "modifyElement"
            assert re.fullmatch(r"way/\d+", operation["data"]["id"])
            (change,) = operation["data"]["operations"]
            assert change["operation"] == "setTags" and set(change["data"]) == {"incline"}
            assert re.fullmatch(r"-?[1-9]\d*%", change["data"]["incline"])
    return tasks


def test_tasks_for_maproulette(mapped: Mapped, tmp_path: Path) -> None:
    given = {"min_percent": "3", "min_drives": "3"}
    whole, notes = mapped.write("maproulette", tmp_path / "whole.geojsonl", **given)
    split, _ = mapped.write("maproulette", tmp_path / "split.geojsonl", kind="split", **given)
    tags, parts = tasks_checked(tmp_path / "whole.geojsonl"), tasks_checked(tmp_path / "split.geojsonl")
    assert (len(tags), len(parts)) == (whole, split) and min(whole, split) > 0
    assert notes == [f"{split} more sections are in the other file: write it with kind=split."]
    assert all("cooperativeWork" in task for task in tags)
    assert not any("cooperativeWork" in task for task in parts)
    for task in tags + parts:
        said = task["features"][0]["properties"]
        assert abs(said["mean_percent"]) >= 2.9 and said["instruction"].startswith("Way ")
        assert f"incline={said['incline_proposed']}" in said["instruction"]


def test_the_layer_for_josm_splits_ways_and_can_not_be_uploaded(mapped: Mapped, tmp_path: Path) -> None:
    count, _ = mapped.write("josm", tmp_path / "review.osm", min_percent="3")
    root = defusedxml.ElementTree.fromstring((tmp_path / "review.osm").read_bytes())
    assert root.attrib["version"] == "0.6"
    assert root.attrib["upload"] == root.attrib["download"] == "never"
    nodes = {int(n.attrib["id"]): n for n in root.findall("node")}
    ways = {int(w.attrib["id"]): w for w in root.findall("way")}
    assert len(nodes) == len(root.findall("node")) and len(ways) == len(root.findall("way"))
    assert not set(nodes) & set(ways) or min(set(nodes) & set(ways)) > 0
    for number, thing in (nodes | ways).items():
        assert number != 0 and ("version" in thing.attrib) == (number > 0)
    original = defusedxml.ElementTree.fromstring(mapped.osm.read_bytes())
    before = {int(w.attrib["id"]): w for w in original.findall("way")}
    tags_of = lambda w: {t.attrib["k"]: t.attrib["v"] for t in w.findall("tag")}  # noqa: E731
    refs_of = lambda w: [int(nd.attrib["ref"]) for nd in w.findall("nd")]  # noqa: E731
    kept = [w for w in ways if w > 0]
    assert kept and set(kept) <= set(before)
    # The pieces of each way, one after another, are the way: its nodes and tags, but for the incline of steep ones.
    pool = [refs_of(w) for number, w in ways.items() if number < 0]
    for number in kept:
        line_of_nodes = refs_of(before[number])
        mine = [
            p
            for p in [*pool, refs_of(ways[number])]
            if "-".join(map(str, p)) in "-".join(map(str, line_of_nodes))
        ]
        joined = sorted(mine, key=lambda p: line_of_nodes.index(p[0]))
        assert joined[0][0] == line_of_nodes[0] and joined[-1][-1] == line_of_nodes[-1]
        assert {k: v for k, v in tags_of(ways[number]).items() if k != "incline"} == tags_of(before[number])
        assert ways[number].attrib["action"] == "modify"
    steep = [w for w in ways.values() if "incline" in tags_of(w)]
    assert len(steep) == count > 0
    assert all(re.fullmatch(r"-?[1-9]\d*%", tags_of(w)["incline"]) for w in steep)
    told = [tags_of(n) for number, n in nodes.items() if number < 0]
    places = [(n.attrib["lat"], n.attrib["lon"]) for n in nodes.values()]
    assert len(set(places)) == len(places), "JOSM takes nodes at one place for copies"
    assert len(told) == count and all("Look at it before you change" in t["note"] for t in told)
    assert all("OpenStreetMap contributors" in t["source"] for t in told)
    assert {n for w in ways.values() for n in refs_of(w)} <= set(nodes)


def test_pieces_meet_at_the_ends_of_sections() -> None:
    slopes = (1.0, 6.0, 9.0, 7.0, 1.0, -6.0, -8.0, 0.5)
    cut = pieces(way(8), found(*slopes))
    assert [(p.first, p.last, p.section and p.section.value) for p in cut] == [
        (0, 1, None), (1, 4, "9%"), (4, 5, None), (5, 7, "-8%"), (7, 8, None),
    ]  # fmt: skip
    assert [(p.first, p.last) for p in pieces(way(3), found(6.0, 8.0, 7.0))] == [(0, 3)]


@pytest.mark.parametrize(
    ("tag", "only", "is_told"),
    [
        ("{p}%", "both", False), ("{m}%", "both", True), ("{m}%", "conflict", True), ("{m}%", "untagged", False),
        ("{up}", "both", True), ("{up}", "conflict", False), ("{down}", "conflict", True), (None, "untagged", True),
        (None, "conflict", False),
    ],
)  # fmt: skip
def test_what_is_tagged_today_counts(tag: str | None, only: str, is_told: bool) -> None:
    """A tag that agrees is left in peace; up and down say nothing against a number of that sign."""
    (section,) = found(8.0, 9.0)
    value = tag and tag.format(p=section.percent + 1, m=-section.percent, up="up", down="down")
    tagged = replace(section, way=way(2, **({"incline": value} if value else {})))
    assert worth_telling([tagged], InclineOptions(only=only)) == ([tagged] if is_told else [])


def test_a_tag_that_is_meant_for_the_steepest_section_is_in_no_conflict_with_the_others() -> None:
    two = [replace(s, way=way(8, incline="9%")) for s in found(1.0, 6.0, 9.0, 7.0, 1.0, -6.0, -8.0, 0.5)]
    assert len(two) == 2 and worth_telling(two, USUAL) == []
    other = [replace(s, way=way(8, incline="20%")) for s in two]
    assert worth_telling(other, USUAL) == other


def test_tags_that_xml_can_not_hold_make_no_broken_layer() -> None:
    odd = replace(found(6.0, 8.0)[0], way=way(2, name='A "B" <C> & \x0b\nD'))
    nodes = {k: OsmNode(8.0 + k / 1000, 49.0, 0) for k in range(3)}
    root = defusedxml.ElementTree.fromstring(
        f"<osm>{''.join(layer_ways(odd.way, [odd], count(-1, -1)))}</osm>"
    )
    tags = {tag.attrib["k"]: tag.attrib["v"] for tag in root.iter("tag")}
    assert tags["name"] == 'A "B" <C> & \nD' and tags["incline"] == "8%"
    assert task_of(odd, nodes, {})["features"][0]["properties"]["@id"] == "way/7"
