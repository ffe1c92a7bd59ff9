"""``versant gnss-study``: tables, picture and figures of a solution, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner, Result

import fusion.formats
import fusion.gnss.positioning
from app.cli.console import Console
from app.cli.track import app
from fusion.errors import MissingSensorError
from fusion.gnss.measurements import Solution
from fusion.gnss.positioning import Positioned
from fusion.types import DriveLog, GnssFix
from published.positioning.rouen import rouen


@pytest.fixture(scope="module")
def studied() -> Positioned:
    """A simulated run whose solution is the truth: residuals are the true errors."""
    drive = rouen(1)
    m, nan = len(drive.ride), np.full((len(drive.ride), 3), np.nan)
    covariance = np.repeat(np.eye(6)[None], m, axis=0)
    nlos = drive.reflected.astype(float)
    solution = Solution(
        drive.ride.position_m, nan, covariance, nan[:, 0], nlos, drive.error_m, np.zeros(m, bool)
    )
    log = DriveLog("simulated", GnssFix.empty(), raw=drive.raw())
    return Positioned(log, "truth", drive.measurements(), solution)


def run(monkeypatch: pytest.MonkeyPatch, found: Positioned, *arguments: str | Path) -> Result:
    def given(*_: Any, **__: Any) -> Positioned:
        return found

    monkeypatch.setattr(fusion.formats, "read_logs", lambda *_, **__: found.log, raising=False)
    monkeypatch.setattr(fusion.gnss.positioning, "positioned", given)
    options = ["--gnss", "receiver"]  # the registry knows it whatever solvers there are
    return CliRunner().invoke(app, ["gnss-study", *map(str, arguments), *options], obj=Console(quiet=True))


@pytest.mark.slow
def test_a_study_is_printed_drawn_and_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, studied: Positioned
) -> None:
    picture, figures = tmp_path / "study.png", tmp_path / "study.json"
    result = run(monkeypatch, studied, "run.obs", "run.nav", "-o", picture, "--json", figures)
    assert result.exit_code == 0, result.output
    for heading in (
        "Residuals by satellite and by reception",
        "Laws (KS is refused above",
        "Sliding windows",
    ):
        assert heading in result.stdout
    assert "G05" in result.stdout
    assert "10 normals" in result.stdout
    with Image.open(picture) as image:
        assert image.size == (1500, 900)
    written = json.loads(figures.read_text())
    assert written["gnss"] == "truth"
    assert written["logs"] == ["run.obs", "run.nav"]
    assert {row["name"] for row in written["states"]} == {"direct", "reflected"}
    assert len(written["laws"]) == 12


def test_positions_without_residuals_are_refused(
    monkeypatch: pytest.MonkeyPatch, studied: Positioned
) -> None:
    result = run(monkeypatch, Positioned(studied.log, "receiver"), "run.obs")
    assert isinstance(result.exception, MissingSensorError)
    assert "there is nothing to study" in str(result.exception)


@pytest.mark.parametrize(
    "arguments",
    [["a.obs", "-o", "x.svg"], ["a.obs", "--gnss-option", "tau_s"], ["a.obs", "-o", "none/x.png"], []],
)
def test_wrong_usage_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, studied: Positioned, arguments: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert run(monkeypatch, studied, *arguments).exit_code == 2
    assert not list(tmp_path.iterdir())
