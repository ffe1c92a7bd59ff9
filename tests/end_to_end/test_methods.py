"""Every registered method the way people run it: through the service, and on a real road with an outage."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.cli import app
from fusion.catalogue import METHODS
from fusion.registry import DEFAULT_METHOD
from fusion.simulate.demonstration import Demonstration
from tests.end_to_end.conftest import COMMAND_S, Up

pytestmark = pytest.mark.slow

QUICK = {"particle": {"particles": 5000}}
FEW_SEGMENTS = 5  # a line through raw altitudes needs long segments


USUAL = (DEFAULT_METHOD, "raw", "particle")
"""Run through the service each time: the default, the simplest, and one of those that take options."""
LONG = pytest.mark.long(
    "the other methods through the service: `fuse` runs each of them on a real road each time"
)
SERVED = [pytest.param(name, marks=() if name in USUAL else LONG) for name in METHODS]


@pytest.fixture(params=list(METHODS))
def method(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.mark.parametrize("method", SERVED)
def test_the_service_runs_it(running: Up, simulated: Demonstration, method: str, tmp_path: Path) -> None:
    log = tmp_path / f"{method}.csv"
    # Other bytes, so that it is another drive: the same bytes again would answer with the first one.
    log.write_text(simulated.drives[0].read_text() + "\n" * (1 + list(METHODS).index(method)))
    with running.client() as client:
        uploaded = client.upload(log, method=method, options=QUICK.get(method, {}))
        drive = client.wait(uploaded.id, timeout_s=COMMAND_S)
        assert drive.status == "done", drive.document
        assert drive.document["report"]["method"] == method
        assert drive.document["report"]["segments_estimated"] > 5
        client.request("DELETE", f"/v1/drives/{drive.id}")


def test_the_service_refuses_an_option_that_it_does_not_have(
    running: Up, simulated: Demonstration, method: str
) -> None:
    with running.http() as http:
        answer = http.post(
            "/v1/drives",
            params={"method": method, "options": json.dumps({"nonsense": 1})},
            files={"file": ("drive.csv", simulated.drives[0].read_bytes())},
        )
    assert answer.status_code == 422
    assert answer.headers["content-type"] == "application/problem+json"
    assert "nonsense" in answer.json()["detail"]


def test_fuse_runs_it_on_a_real_road_with_an_outage(
    method: str, karlsruhe: Path, receiver_log: Callable[..., Path], tmp_path: Path
) -> None:
    log, out = receiver_log("09", tmp_path / "log.csv", cut=["60:40"]), tmp_path / "slopes.geojson"
    options = [f"--option={name}={value}" for name, value in QUICK.get(method, {}).items()]
    fused = CliRunner().invoke(app, [
        "fuse", str(log), "--roads", str(karlsruhe / "roads_09_10.osm"), "--method", method, "-o", str(out),
        "--dem", *map(str, sorted(karlsruhe.glob("*.hgt"))), *options,
    ])  # fmt: skip
    assert fused.exit_code == 0, fused.stderr
    slopes = [f["properties"] for f in json.loads(out.read_text())["features"]]
    assert len(slopes) >= FEW_SEGMENTS
    assert all(math.isfinite(p["slope_percent"]) and p["slope_sigma_percent"] > 0 for p in slopes)
