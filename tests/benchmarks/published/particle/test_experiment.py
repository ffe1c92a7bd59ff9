"""Al Assaad's experiment: what is measured is what its tables show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from published.particle import calais


@pytest.mark.slow
def test_calais_measures_what_its_tables_show(tmp_path: Path) -> None:
    """Every case on one drive, by the Kalman filter where there are particles: the limits of the issue hold."""
    scene = calais.Scene.make(2, calais.RECEIVER, tmp_path)
    for case in calais.CASES:
        swift = {**case.options, "filter": "ekf"} if case.method == "particle" else case.options
        figures = calais.measure(scene, replace(case, options=swift))
        shown = {quantity for quantity, _, _ in case.quantities if "receiver m8" not in quantity}
        assert shown - set(figures) <= {"epochs resampled, threshold 0.1"}
        assert figures["map-match rate"] >= 94
        assert figures["matches on the segment driven"] > 90
        assert figures["pitch, std"] < 0.08
        assert 40 < figures["segments with a slope"] < 75
        if case.velocity:
            assert figures["position U, std, beside GNSS alone"] < 0.6
            assert figures["pitch, std"] < 0.05


def test_published_quantities_are_measured_ones() -> None:
    """Each note names a case and a quantity that its table has; a slip would drop it silently."""
    names = {(case.name, quantity) for case in calais.CASES for quantity, _, _ in case.quantities}
    assert set(calais.NOTES) <= names
