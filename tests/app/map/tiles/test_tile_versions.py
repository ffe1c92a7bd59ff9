"""Tiles over HTTP are new where something changed and on the next request, and unchanged everywhere else."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from drawn_support import draw
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import drive_over
from processing_support import carry_out_removals
from road_support import replace_roads

HERE, THERE = "/tiles/14/8579/5626", "/tiles/14/8624/5626"
ABOVE_HERE, ABOVE_THERE, BOTH = "/tiles/10/536/351", "/tiles/10/539/351", "/tiles/6/33/21"
NEAR = {HERE, ABOVE_HERE, BOTH}
FAR = {THERE, ABOVE_THERE}


@pytest.mark.parametrize("suffix", [".mvt", ".geojson"])
def test_tiles_are_new_where_something_changed_and_only_there(
    web: Any, streets_apart: tuple[RoadTable, Ints], suffix: str
) -> None:
    table, ids = streets_apart
    tags: dict[str, str] = {}

    def statuses() -> dict[str, int]:
        """What each tile answers to who has seen it before."""
        draw(web.sessions)
        found = {}
        for tile in NEAR | FAR:
            known = {"If-None-Match": tags[tile]} if tile in tags else {}
            answer = web.client.get(tile + suffix, headers=known)
            found[tile], tags[tile] = answer.status_code, answer.headers["etag"]
        return found

    unchanged, changed = dict.fromkeys(NEAR | FAR, 304), dict.fromkeys(NEAR, 200) | dict.fromkeys(FAR, 304)
    assert 304 not in statuses().values()
    assert statuses() == unchanged
    drive = drive_over(web.sessions, table, ids, dict.fromkeys(range(8), (2.0, 0.5)))
    assert statuses() == changed
    assert statuses() == unchanged
    drive_over(web.sessions, table, ids, dict.fromkeys(range(8), (2.0, 0.5)), begin_s=1.6e9)
    assert statuses() == changed
    assert web.client.delete(f"/v1/drives/{drive}").status_code == 202
    assert statuses() == unchanged
    carry_out_removals(web.sessions, web.blobs)
    assert statuses() == changed
    with web.sessions.begin() as session:
        renamed = ["primary" if k == 3 else name for k, name in enumerate(table.highway)]
        replace_roads(session, replace(table, highway=np.array(renamed, object)), "x", "1" * 64)
    assert statuses() == changed
    assert statuses() == unchanged
