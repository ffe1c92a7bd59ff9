"""A long street with a side street at every node, and drives of several owners along it."""

from __future__ import annotations

import uuid
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import date, timedelta
from itertools import count

import numpy as np
import pytest
from sqlalchemy import text

from access_support import give_drive
from app.access import store as access
from app.core.blobs import BlobStore
from app.core.db import Sessions
from app.core.settings import Settings
from app.network import extracts
from app.releases.run import release
from app.releases.store import Edition
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import Rows, drive_over, rows_of
from road_support import replace_roads

LONG = 40
"""Segments of the street, 73 m each."""
MIDDLE = range(7, 33)
"""Those that lie at no end of a trip along the whole street, whatever radius is drawn."""


def street_with_junctions() -> RoadTable:
    """Segments 0 to ``LONG`` - 1 run east; at each node between them a side street begins."""
    k, sides = np.arange(LONG), np.arange(1, LONG)
    east = np.concatenate([k, sides]) * 0.001 + 8.5
    n = len(east)
    return RoadTable.from_columns(
        osm_way_id=np.concatenate([np.full(LONG, 7), 100 + sides]),
        from_node=np.concatenate([1000 + k, 1000 + sides]),
        to_node=np.concatenate([1001 + k, 2000 + sides]),
        lon0_deg=east,
        lat0_deg=np.full(n, 49.0),
        lon1_deg=np.concatenate([(k + 1) * 0.001, sides * 0.001]) + 8.5,
        lat1_deg=np.concatenate([np.full(LONG, 49.0), np.full(LONG - 1, 49.0005)]),
        oneway=np.zeros(n),
        bridge=np.zeros(n, bool),
        tunnel=np.zeros(n, bool),
        layer=np.zeros(n),
        highway=["residential"] * n,
        name=["Straße"] * n,
    )


@dataclass
class Public:
    """A service with that street, owners who drive along it, and its editions."""

    sessions: Sessions
    settings: Settings
    table: RoadTable
    ids: Ints
    owners: list[int]
    blobs: BlobStore = field(default_factory=lambda: BlobStore("memory://blobs"))
    day: date = date(2026, 11, 2)
    days: Iterator[int] = field(default_factory=count)
    """Of drives: two at one moment would be one drive, logged twice."""

    def drive(self, owner: int, rows: Sequence[int], slope_percent: float = 3.0) -> uuid.UUID:
        """A drive of an owner over these segments, at a time of its own."""
        moment = 1_700_000_000.0 + 100_000.0 * next(self.days)
        said = dict.fromkeys(rows, (slope_percent, 0.5))
        drive = drive_over(self.sessions, self.table, self.ids, said, moment)
        give_drive(self.sessions, drive, self.owners[owner])
        return drive

    def release(self) -> Edition:
        """The next week's edition."""
        self.day += timedelta(days=7)
        return release(str(self.settings.database_url), self.settings, day=self.day)

    def served(self) -> Rows:
        """What the edition says, by the street's rows."""
        row_of = {int(segment): row for row, segment in enumerate(self.ids)}
        return {row_of[k]: v for k, v in rows_of(self.sessions, "edition.segment_slopes").items() if v[2] > 0}

    def told(self) -> Counter[int]:
        """How many passes are told, by the street's rows."""
        row_of = {int(segment): row for row, segment in enumerate(self.ids)}
        with self.sessions() as session:
            return Counter(
                row_of[k] for k in session.execute(text("SELECT segment_id FROM told.drive_passes")).scalars()
            )

    def count(self, query: str) -> int:
        """What a query of one number answers."""
        with self.sessions() as session:
            return int(session.execute(text(query)).scalar_one())


@pytest.fixture
def public(sessions: Sessions, database_url: str) -> Public:
    """With seven owners, of whom five have to contribute (3, and 2 that may work together)."""
    with sessions.begin() as session:
        replace_roads(session, street_with_junctions(), "street.osm", "0" * 64)
        owners = [access.create_owner(session, f"owner {k}").id for k in range(7)]
    with sessions() as session:
        table, ids = extracts.all_roads(session)
    order = np.argsort(table.from_node * 10_000 + table.osm_way_id)  # the street first, from west to east
    street = order[np.isin(order, np.flatnonzero(table.osm_way_id == 7))]
    assert len(street) == LONG
    rows = np.concatenate([street, np.setdiff1d(order, street)])
    settings = Settings(database_url=database_url, public_map="releases")
    return Public(sessions, settings, table.subset(rows), ids[rows], owners)
