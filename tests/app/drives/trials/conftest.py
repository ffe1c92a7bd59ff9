"""A service that knows the town, with a drive through it that is done."""

from __future__ import annotations

import shutil
import uuid
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from app.drives.process import Outcome
from processing_support import process_drive
from web_fixtures import Web


@pytest.fixture
def town_web(town_database: str, town_rasters: Path, web: Web) -> Web:
    """The town's roads and elevation in the service's database."""
    place = web.settings.dem_dir
    assert isinstance(place, Path)
    shutil.copytree(town_rasters, place, dirs_exist_ok=True)
    return web


@pytest.fixture
def driven(town_web: Web, files: Path) -> str:
    """The address of a drive by method raw that is done."""
    with (files / "0.csv").open("rb") as file:
        answer: Any = town_web.client.post("/v1/drives?method=raw", files={"file": file})
    drive = answer.json()["id"]
    assert process_drive(town_web.context, uuid.UUID(drive), 1) is Outcome.DONE
    return f"/v1/drives/{drive}"


@pytest.fixture
def uploaded(filled: Web) -> str:
    """The address of a drive along a street of the grid that waits to be processed: a trial waits for no drive."""
    rows = [f"{1_700_000_000 + k},{49.0001 + 9e-5 * k:.7f},8.4,{120 + 0.3 * k:.2f}" for k in range(60)]
    log = "\n".join(["time_s,lat_deg,lon_deg,alt_msl_m", *rows])
    drive = filled.client.post("/v1/drives?method=raw", content=log.encode()).json()["id"]
    with filled.sessions.begin() as session:
        session.execute(text("DELETE FROM procrastinate_jobs"))
    return f"/v1/drives/{drive}"
