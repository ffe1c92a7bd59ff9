"""An owner with a drive that was computed, one that waits, and what else an owner may have."""

from __future__ import annotations

import uuid
from dataclasses import dataclass
from pathlib import Path

import pytest

from access_support import Keyed
from app.drives.process import Outcome
from app.roads import imports as road_imports
from processing_support import process_drive

NAME = "max.mustermann.csv"


@dataclass(frozen=True)
class Anna:
    """The owner of that name of a service, and its things."""

    keyed: Keyed
    done: str
    waiting: str
    logs: dict[str, bytes]
    """Of each drive."""


@pytest.fixture
def anna(keyed: Keyed, files: Path) -> Anna:
    web, client = keyed.web, keyed.a.own.client
    road_imports.import_roads(web.sessions, files / "town.osm", web.settings.dem_dir)
    logs: dict[str, bytes] = {}
    for name in ("0.csv", "1.csv"):
        content = (files / name).read_bytes()
        sent = client.post("/v1/drives?method=profile", files={"file": (NAME, content)})
        logs[sent.json()["id"]] = content
    done, waiting = logs
    assert process_drive(web.context, uuid.UUID(done), 1) is Outcome.DONE
    return Anna(keyed, done, waiting, logs)
