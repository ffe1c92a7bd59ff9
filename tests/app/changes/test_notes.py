"""What triggers note, whoever writes: every segment of which anything shown changed, and no other."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Annotated, ClassVar, get_args, get_origin, get_type_hints

import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.db import Sessions
from app.map.segment import Column, Segment

SLOPES = """
    INSERT INTO segment_slopes (segment_id, slope_percent, slope_sigma_percent, drives, observations, height_from_m)
    SELECT id, 1, 1, 1, 1, 100 FROM segments WHERE id IN (3, 4, 5)
    ON CONFLICT (segment_id) DO UPDATE SET slope_percent = excluded.slope_percent, updated_at = now()
    WHERE segment_slopes.slope_percent <> excluded.slope_percent
"""
Notes = Callable[..., dict[int, str]]


@pytest.fixture
def session(mapped: Sessions) -> Iterator[Session]:
    """A transaction over segments of which 3 has a slope; taken back."""
    with mapped() as session:
        session.execute(text(SLOPES.replace("3, 4, 5", "3")))
        yield session
        session.rollback()


@pytest.fixture
def notes(session: Session) -> Notes:
    """``notes(*statements)``: the segments that these note, each as "there", "moved" or "gone"."""

    def noted(*statements: str) -> dict[int, str]:
        session.execute(text("UPDATE segment_changes SET xid = 0"))
        for statement in statements:
            session.execute(text(statement))
        found = text(
            "SELECT segment_id, gone, was IS NOT NULL AS moved FROM segment_changes WHERE xid = versant_xid()"
        )
        return {
            row.segment_id: "gone" if row.gone else "moved" if row.moved else "there"
            for row in session.execute(found)
        }

    return noted


def test_roads_that_come_are_noted(notes: Notes) -> None:
    found = notes(
        """
        INSERT INTO segments (osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge,
                              tunnel, layer, road_version_id)
        SELECT 999, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge, tunnel, layer,
               road_version_id
        FROM segments WHERE id <= 2
        """
    )
    assert list(found.values()) == ["there", "there"]
    assert min(found) > 2


SHOWN = {
    "osm_way_id": "77", "from_node": "7", "to_node": "7", "length_m": "7", "highway": "'x'", "name": "'x'",
    "oneway": "1 - oneway * oneway", "bridge": "NOT bridge", "tunnel": "NOT tunnel", "dem_slope_percent": "7",
}  # fmt: skip
PUBLISHED = {
    "slope_percent": "7", "slope_sigma_percent": "7", "drives": "7", "observations": "7", "driven_share": "0.7",
    "height_from_m": "7", "height_to_m": "7", "height_sigma_m": "7", "steepest_percent": "7", "steepest_from_m": "7",
    "steepest_to_m": "7", "updated_at": "now() + interval '1 s'",
}  # fmt: skip


def test_every_property_that_outputs_have_is_among_those_that_are_tried() -> None:
    """A new property has to be noted by the triggers as well, and be tried here."""
    read = set()
    for name, hint in get_type_hints(Segment, include_extras=True).items():
        if get_origin(hint) is Annotated:
            column = next(one for one in get_args(hint) if isinstance(one, Column))
            read |= set(re.findall(r"\b([as])\.(\w+)", column.sql))
        elif get_origin(hint) is not ClassVar:
            assert name == "coordinates"
    # The coordinates are no column, and the steepness is the slope's.
    assert len(read) == len(fields(Segment)) - 2
    assert read - {("s", "id")} == {("s", name) for name in SHOWN} | {("a", name) for name in PUBLISHED}


@pytest.mark.parametrize(("column", "value"), SHOWN.items())
def test_each_property_of_a_road_is_noted(notes: Notes, column: str, value: str) -> None:
    assert notes(f"UPDATE segments SET {column} = {value} WHERE id IN (2, 3)") == {2: "there", 3: "there"}


@pytest.mark.parametrize(("column", "value"), PUBLISHED.items())
def test_each_property_of_a_slope_is_noted(notes: Notes, column: str, value: str) -> None:
    assert notes(f"UPDATE segment_slopes SET {column} = {value}") == {3: "there"}
    assert notes(f"UPDATE segment_slopes SET {column} = {column}") == {}


def test_a_property_that_becomes_unknown_is_noted(notes: Notes) -> None:
    assert notes("UPDATE segment_slopes SET height_from_m = NULL") == {3: "there"}
    assert notes("UPDATE segments SET name = NULL WHERE id = 1") == {1: "there"}


@pytest.mark.parametrize(
    "statement",
    [
        "UPDATE segments SET layer = 3, regions = '{9}', dem_heights_m = '{1,2}'",
        "UPDATE segments SET name = name, geom = geom, length_m = length_m",
        "UPDATE network_slopes SET slope_percent = 9",
        "DELETE FROM segments WHERE id < 0",
        "UPDATE segments SET name = 'x' WHERE id < 0",
        SLOPES.replace("3, 4, 5", "3"),
    ],
)
def test_what_is_not_shown_is_not_noted(notes: Notes, statement: str) -> None:
    assert notes(statement) == {}


def test_a_road_that_moves_is_noted_with_where_it_was_and_all_places_add_up(
    notes: Notes, session: Session
) -> None:
    moved = "UPDATE segments SET geom = ST_Translate(geom, {}, 0) WHERE id = 1"
    before = session.execute(text("SELECT geom FROM segments WHERE id = 1")).scalar_one()
    assert notes(moved.format(1)) == {1: "moved"}
    assert notes(moved.format(1), "UPDATE segments SET name = 'x' WHERE id = 1") == {1: "moved"}
    all_of_it = text(
        """
        SELECT ST_XMin(c.was) = ST_XMin(b.geom) AND ST_XMax(c.was) = ST_XMax(b.geom) + 1
        FROM segment_changes AS c, CAST(:before AS geometry) AS b (geom) WHERE c.segment_id = 1
        """
    )
    assert session.execute(all_of_it, {"before": str(before)}).scalar_one()


def test_a_road_that_goes_takes_its_slope_along_and_is_gone(notes: Notes) -> None:
    assert notes("DELETE FROM segments WHERE id IN (2, 3)") == {2: "gone", 3: "gone"}


def test_slope_and_road_that_go_in_one_statement_are_gone(notes: Notes) -> None:
    both = "WITH s AS (DELETE FROM segment_slopes WHERE segment_id = 3) DELETE FROM segments WHERE id = 3"
    assert notes(both) == {3: "gone"}


def test_a_slope_that_comes_or_goes_changes_a_road_that_stays(notes: Notes) -> None:
    assert notes(SLOPES) == {4: "there", 5: "there"}
    assert notes("DELETE FROM segment_slopes") == {3: "there", 4: "there", 5: "there"}


def test_what_is_written_and_what_is_new_of_one_statement_are_both_noted(notes: Notes) -> None:
    assert notes(SLOPES.replace("SELECT id, 1", "SELECT id, 2")) == {3: "there", 4: "there", 5: "there"}


def test_a_road_that_goes_and_comes_back_is_there(notes: Notes) -> None:
    away, back = (
        "CREATE TEMP TABLE kept ON COMMIT DROP AS SELECT * FROM segments WHERE id = 2",
        """
        INSERT INTO segments (id, osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge,
                              tunnel, layer, road_version_id)
        SELECT id, osm_way_id, from_node, to_node, geom, geom_3857, length_m, highway, oneway, bridge, tunnel, layer,
               road_version_id FROM kept
    """,
    )
    assert notes(away, "DELETE FROM segments WHERE id = 2") == {2: "gone"}
    assert notes(back) == {2: "moved"}


def test_tables_that_are_emptied_are_noted(notes: Notes, session: Session) -> None:
    assert notes("TRUNCATE segment_slopes") == {3: "there"}
    count = session.execute(text("SELECT count(*) FROM segments")).scalar_one()
    gone = notes("TRUNCATE segments CASCADE")
    assert set(gone.values()) == {"gone"}
    assert len(gone) == count


def test_rows_that_are_copied_are_noted(notes: Notes, session: Session) -> None:
    notes()
    columns = "segment_id, slope_percent, slope_sigma_percent, drives, observations"
    raw = session.connection().connection.cursor()
    with raw.copy(f"COPY segment_slopes ({columns}) FROM STDIN") as copy:  # type: ignore[attr-defined]
        copy.write("7\t1\t1\t1\t1\n8\t1\t1\t1\t1\n")
    found = text("SELECT segment_id FROM segment_changes WHERE xid = versant_xid() ORDER BY 1")
    assert list(session.execute(found).scalars()) == [7, 8]


def test_cells_note_who_raised_what_is_shown_of_them(mapped: Sessions) -> None:
    with mapped() as session:
        session.execute(text("INSERT INTO cells (id) VALUES (5)"))
        mine = text("SELECT changed_xid = versant_xid() FROM cells WHERE id = 5")
        assert session.execute(mine).scalar_one()
        for change, noted in (
            ("version = version + 1", True),
            ("drawn_version = drawn_version + 1", True),
            ("road_state = 7", False),
            ("changed_at = now()", False),
        ):
            session.execute(text("UPDATE cells SET changed_xid = 0 WHERE id = 5"))
            session.execute(text(f"UPDATE cells SET {change} WHERE id = 5"))
            assert session.execute(mine).scalar_one() is noted
        session.rollback()
