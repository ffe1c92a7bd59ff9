"""The picture of a study: all its parts are there, and odd solutions do not break it."""

from __future__ import annotations

from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from app.drives.outputs.gnss_picture import gnss_figure, gnss_png
from fusion.gnss.measurements import Measurements, Solution
from fusion.published.positioning.laws import law_tests
from published.positioning.rouen import rouen


@pytest.fixture(scope="module")
def run() -> tuple[Measurements, Solution]:
    """The truth as a solution: residuals are the true errors."""
    drive = rouen(1)
    m, nan = len(drive.ride), np.full((len(drive.ride), 3), np.nan)
    covariance = np.repeat(np.eye(6)[None], m, axis=0)
    nlos = drive.reflected.astype(float)
    solution = Solution(
        drive.ride.position_m, nan, covariance, nan[:, 0], nlos, drive.error_m, np.zeros(m, bool)
    )
    return drive.measurements(), solution


def test_a_study_has_its_four_parts(run: tuple[Measurements, Solution]) -> None:
    measured, solution = run
    laws = law_tests(solution.residual_m[:500], ("normal", "rayleigh", "2 normals"))
    figure = gnss_figure(measured, solution, laws, "a $run")
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    labels = [axes.get_ylabel() + axes.get_xlabel() for axes in figure.axes]
    assert "Residuals by satellite" in titles
    assert any(t.startswith("Nearest law: 2 normals") for t in titles)
    assert any(t.startswith("Farthest law: rayleigh") for t in titles)
    assert any("Probability of having been reflected" in label for label in labels)
    assert any("Measured minus predicted (m)" in label for label in labels)
    names = {text.get_text() for text in figure.axes[0].texts}
    assert set(measured.names) <= names
    said = " ".join(text.get_text() for text in figure.texts)
    assert "594 of 594 epochs with a position, 0 by the motion alone" in said


def test_without_probabilities_the_sky_shows_cn0(run: tuple[Measurements, Solution]) -> None:
    measured, solution = run
    silent = replace(solution, nlos=np.full(len(solution.nlos), np.nan))
    figure = gnss_figure(measured, silent, [], "run")
    assert any(axes.get_xlabel() == "C/N0 (dB-Hz)" for axes in figure.axes)


def test_a_solution_that_knows_nothing_is_drawn(run: tuple[Measurements, Solution]) -> None:
    measured, solution = run
    none = replace(
        solution,
        position_m=np.full_like(solution.position_m, np.nan),
        residual_m=np.full_like(solution.residual_m, np.nan),
        covariance=np.full_like(solution.covariance, np.nan),
        nlos=np.full_like(solution.nlos, np.nan),
    )
    image = Image.open(BytesIO(gnss_png(measured, none, [], "no\x00thing $x")))
    assert image.format == "PNG"
    assert image.size == (1500, 900)
