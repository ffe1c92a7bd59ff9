"""The bound of a road: made for the slopes that the truth has, or refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from accuracy.bounds import RoadBound
from accuracy.sequences import Sequence
from accuracy.streets import make_street
from accuracy.truth import TrueSlope, Truth

TRUTH: Truth = {(1, 1, 2): TrueSlope(2.0, 50.0, 50.0), (1, 2, 3): TrueSlope(-1.0, 50.0, 50.0)}


def tool(*names: tuple[str, str, str]) -> Any:
    """A tool that knows three heights, and slopes between neighbours, 50 m apart."""
    rows = np.array([[-2.0, 2.0, 0.0], [0.0, -2.0, 2.0]])
    return cast(
        Any,
        SimpleNamespace(
            Reference=lambda path: SimpleNamespace(z=np.array([100.0, 101.0, 100.5]), path=path),
            segment_rows=lambda reference, roads: (list(names), rows[: len(names)]),
            suspension=lambda reference: (0.01, 1.0),
            roughness=lambda reference: 1e-5,
            equations=lambda reference, log, *rest: (log, *rest),
            errors=lambda reference, rows, drives, roughness: {"q": [roughness, len(drives)]},
        ),
    )


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    (tmp_path / "roads_07.osm").touch()
    roads = make_street(np.array([0.0, 50.0, 100.0]), np.zeros(3), np.zeros(3)).roads
    return Sequence("07", TRUTH, roads, None, tmp_path / "ref_07.csv", None)


def test_the_road_is_read_once_and_used_for_every_drive(sequence: Sequence) -> None:
    bound = RoadBound.of(tool(("1", "1", "2"), ("1", "2", "3")), sequence)
    assert bound.keys == [(1, 1, 2), (1, 2, 3)]
    drive = bound.drive(Path("x.csv"), "m8", 5, ["alt"])
    assert drive == ("x.csv", "m8", 5, (0.01, 1.0), ["alt"])
    assert bound.errors([drive, drive])["q"].tolist() == [1e-5, 2.0]


def test_a_bound_of_other_slopes_is_refused(sequence: Sequence) -> None:
    with pytest.raises(ValueError, match="other slopes"):
        RoadBound.of(tool(("1", "1", "2")), sequence)
    with pytest.raises(ValueError, match="other slopes"):
        RoadBound.of(tool(("1", "1", "2"), ("1", "3", "2")), sequence)
    steeper = dataclasses.replace(sequence, truth={**TRUTH, (1, 1, 2): TrueSlope(2.5, 50.0, 50.0)})
    with pytest.raises(ValueError, match="other slopes"):
        RoadBound.of(tool(("1", "1", "2"), ("1", "2", "3")), steeper)
