"""Editions out of the database, and the statements by which one is made of what may be told."""

from __future__ import annotations

import uuid
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from datetime import date
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.caller import present_caller
from app.core.db import fetch_binary
from app.core.tables import IS_SHOWN
from app.core.text import dumps
from app.releases.ends import Circle, Driven, Timed


@dataclass(frozen=True)
class Edition:
    """An edition of the map for the public."""

    number: int
    day: date
    owners: int
    """Among so many each is hidden, even from those that work together."""
    owners_needed: int
    """Distinct owners who drove a segment of it."""
    segments: int
    length_m: float
    withheld_share: float | None
    """Of the driven segments; None where none is driven. Two decimals, as of their length."""
    withheld_length_share: float | None
    files: list[dict[str, Any]]
    """Of those that are kept: ``name``, ``media_type``, ``size_bytes``, ``sha256``."""


_COLUMNS = ", ".join(one.name for one in fields(Edition))
_LIST = text(f"SELECT {_COLUMNS} FROM editions ORDER BY number DESC")  # noqa: S608 - constants
_LATEST = text(f"SELECT {_COLUMNS} FROM editions ORDER BY number DESC LIMIT 1")  # noqa: S608 - constants
_ONE = text(f"SELECT {_COLUMNS} FROM editions WHERE number = :number")  # noqa: S608 - constants
# What every document of an edition says of it.
_NOTED = ("number", "day", "owners", "owners_needed")
_NAME_FILES = text("UPDATE editions SET files = CAST(:files AS jsonb) WHERE number = :number")
# As they were, the rows of editions that named any file.
_FORGET_FILES = text(f"""
    UPDATE editions AS now SET files = '[]' FROM editions AS e
    WHERE now.number = e.number AND e.files <> '[]'
        AND e.number NOT IN (SELECT number FROM editions WHERE files <> '[]' ORDER BY number DESC LIMIT :keep)
    RETURNING {", ".join(f"e.{one.name}" for one in fields(Edition))}
""")  # noqa: S608 - constants


def list_editions(session: Session) -> list[Edition]:
    """All editions, the newest first."""
    return [_edition(row) for row in session.execute(_LIST)]


def latest_edition(session: Session) -> Edition | None:
    """The newest edition; None: there is none yet."""
    row = session.execute(_LATEST).one_or_none()
    return None if row is None else _edition(row)


def get_edition(session: Session, number: int) -> Edition | None:
    """The edition of that number; None: there is none."""
    row = session.execute(_ONE, {"number": number}).one_or_none()
    return None if row is None else _edition(row)


def edition_note(session: Session) -> dict[str, Any]:
    """The member ``edition`` of a document of the map: which one the present caller sees; none of the live map."""
    edition = latest_edition(session) if present_caller().sees == "edition" else None
    return {} if edition is None else {"edition": identity(edition)}


def identity(edition: Edition) -> dict[str, Any]:
    """What every document of an edition says of it: which one it is, and among how many owners each is hidden."""
    return {**{name: getattr(edition, name) for name in _NOTED}, "day": edition.day.isoformat()}


def name_files(session: Session, edition: Edition) -> None:
    """Note which files are kept of the edition: those that it names."""
    session.execute(_NAME_FILES, {"number": edition.number, "files": dumps(edition.files)})


def forget_files(session: Session, keep: int) -> list[Edition]:
    """Let all editions but the newest that have files, ``keep`` of them, have none; what changed, as it was."""
    return [_edition(row) for row in session.execute(_FORGET_FILES, {"keep": keep})]


def _edition(row: Row[Any]) -> Edition:
    return Edition(**row._mapping)


class ToExamine(NamedTuple):
    """A drive whose passes, or whose owner's zones, have changed since its ends were looked for."""

    drive_id: uuid.UUID
    owner_id: int
    state: str


EXAMINED_BY = "2"
"""Raise it whenever the same drive would be examined with another result."""

# What is called by its bare name here is the live map's; the search path is the usual one until ``read_told``.
_TO_EXAMINE = text(f"""
    WITH zones AS (
        SELECT owner_id, md5(string_agg(concat_ws(' ', id, lon_deg, lat_deg, radius_m), ',' ORDER BY id)) AS state
        FROM owner_zones GROUP BY owner_id
    ), driven AS (
        SELECT drive_id, concat_ws('-', count(*), max(id)) AS state FROM drive_passes GROUP BY drive_id
    ), now AS (
        SELECT d.id, d.owner_id, concat_ws('.', '{EXAMINED_BY}', p.state, z.state) AS state
        FROM driven AS p JOIN drives AS d ON d.id = p.drive_id LEFT JOIN zones AS z ON z.owner_id = d.owner_id
        WHERE {IS_SHOWN.format("d")} AND d.duplicate_of IS NULL
    )
    SELECT n.* FROM now AS n LEFT JOIN told.examined AS e ON e.drive_id = n.id
    WHERE e.state IS DISTINCT FROM n.state ORDER BY n.id
""")  # noqa: S608 - constants
_NOTE_EXAMINED = text("""
    INSERT INTO told.examined (drive_id, state, hidden)
    SELECT id, :state, CAST(:hidden AS integer[]) FROM drives WHERE id = :drive_id
    ON CONFLICT (drive_id) DO UPDATE SET state = excluded.state, hidden = excluded.hidden
""")
# The roles of the API may not look into ``told``; by these functions an owner is answered what is his own.
_PLACES = text("SELECT lon_deg, lat_deg, radius_m FROM versant_places(:owner_id) ORDER BY id")
_PLACE_SHARE = text("SELECT versant_place_share(:owner_id, :lon_deg, :lat_deg)")
_ADD_PLACE = text("""
    INSERT INTO told.places (owner_id, lon_deg, lat_deg, radius_m)
    SELECT id, :lon_deg, :lat_deg, :radius_m FROM owners WHERE id = :owner_id
""")
_ZONES = text("SELECT lon_deg, lat_deg, radius_m FROM owner_zones WHERE owner_id = :owner_id ORDER BY id")
_TRACKS = "SELECT drive_id, track FROM drive_tracks WHERE drive_id = ANY(%(ids)s)"
_ROAD = """s.from_node, s.to_node, ST_X(ST_StartPoint(s.geom)), ST_Y(ST_StartPoint(s.geom)),
           ST_X(ST_EndPoint(s.geom)), ST_Y(ST_EndPoint(s.geom))"""
_DRIVEN = f"""
    SELECT p.drive_id, p.sequence, p.segment_id, {_ROAD}, p.entered_s
    FROM drive_passes AS p JOIN segments AS s ON s.id = p.segment_id
    WHERE p.drive_id = ANY(%(ids)s) ORDER BY p.drive_id, p.sequence
"""  # noqa: S608 - constants
_ROADS = f"SELECT s.id, {_ROAD} FROM segments AS s WHERE s.id = ANY(%(ids)s::bigint[])"  # noqa: S608 - constants
# Nodes have no index of their own: their places have.
_ROADS_AT = """
    WITH known AS (
        SELECT DISTINCT ON (node) node, place FROM (
            SELECT from_node AS node, ST_StartPoint(geom) AS place FROM segments WHERE id = ANY(%(ids)s)
            UNION ALL SELECT to_node, ST_EndPoint(geom) FROM segments WHERE id = ANY(%(ids)s)) AS both_ends
    )
    SELECT k.node, count(*) FROM known AS k
    JOIN segments AS s ON s.geom && ST_Expand(k.place, 1e-7) AND (s.from_node = k.node OR s.to_node = k.node)
    GROUP BY k.node
"""


def to_examine(session: Session) -> list[ToExamine]:
    """The drives whose ends have to be looked for."""
    return [ToExamine(*row) for row in session.execute(_TO_EXAMINE)]


def note_examined(session: Session, drive: ToExamine, hidden: Sequence[int]) -> None:
    """These passes of the drive, by their numbers, are told to nobody. Nothing where it was removed meanwhile."""
    values = {"drive_id": drive.drive_id, "state": drive.state, "hidden": list(hidden)}
    session.execute(_NOTE_EXAMINED, values)


def places(session: Session, owner_id: int) -> list[Circle]:
    """The owner's places that are known, in the order in which they came to be; none for who may not ask."""
    return [Circle(*circle) for circle in session.execute(_PLACES, {"owner_id": owner_id})]


def place_share(session: Session, owner_id: int, lon_deg: float, lat_deg: float) -> float:
    """What is drawn for an owner's place that is not known, 0 to 1: the same whenever it is asked."""
    values = {"owner_id": owner_id, "lon_deg": lon_deg, "lat_deg": lat_deg}
    return float(session.execute(_PLACE_SHARE, values).scalar_one())


def add_place(session: Session, owner_id: int, circle: Circle) -> None:
    """Keep a place; nothing where the owner was removed meanwhile."""
    session.execute(_ADD_PLACE, {"owner_id": owner_id, **asdict(circle)})


def zones(session: Session, owner_id: int) -> list[Circle]:
    """The owner's zones."""
    return [Circle(*circle) for circle in session.execute(_ZONES, {"owner_id": owner_id})]


def tracks(session: Session, drive_ids: Sequence[uuid.UUID]) -> dict[uuid.UUID, Timed]:
    """Where those of the drives were when that have a track (``app.drives.tracks``)."""
    return {
        drive_id: _timed(data) for drive_id, data in fetch_binary(session, _TRACKS, {"ids": list(drive_ids)})
    }


def _timed(data: bytes) -> Timed:
    table = pa.ipc.open_stream(data).read_all()
    return Timed(*(table.column(one.name).to_numpy() for one in fields(Timed)))


def driven(session: Session, drive_ids: Sequence[uuid.UUID]) -> dict[uuid.UUID, Driven]:
    """The passes of those of the drives that have any."""
    rows = fetch_binary(session, _DRIVEN, {"ids": list(drive_ids)})
    by_drive = groupby(rows, key=lambda row: row[0])
    return {drive_id: driven_of([row[1:] for row in of_drive]) for drive_id, of_drive in by_drive}


def driven_of(passes: Sequence[tuple[Any, ...]]) -> Driven:
    """These passes, each as ``Driven`` has it; at least one."""
    columns: list[NDArray[Any]] = [np.array(column) for column in zip(*passes, strict=True)]
    return Driven(*columns)


def roads(session: Session, segment_ids: Sequence[int]) -> dict[int, list[Any]]:
    """Nodes and ends of those of the segments that there are, as a pass over one has them (``driven_of``)."""
    return {number: of_road for number, *of_road in fetch_binary(session, _ROADS, {"ids": list(segment_ids)})}


def roads_at(session: Session, segment_ids: Sequence[int]) -> dict[int, int]:
    """How many segments meet at each node of these."""
    return dict(fetch_binary(session, _ROADS_AT, {"ids": list(segment_ids)}))
