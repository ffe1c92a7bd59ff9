"""Altimeters that are late: factors made anew for the lag that the stored network finds."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from altimeter_support import altimeter_gpx
from app.core.db import Sessions
from app.drives import process, writing
from app.drives.process import Outcome
from app.drives.writing import with_settled_lag
from app.jobs.context import JobContext
from drive_fixtures import Send
from fusion.lags import LAG_ROUNDS, LAG_STEP_S
from fusion.methods.base import DriveResult
from fusion.network.pass_factor import LAG, NUISANCES, PassFactor
from fusion.roads.table import RoadTable
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town
from fusion.types import Ints
from network_support import passes_of, rows_of

Chain = Callable[..., RoadTable]


def late(factor: PassFactor, lag_s: float, sigma_s: float = 0.1) -> PassFactor:
    """The pass, which also measured how late its altimeter is."""
    information, vector = factor.information.copy(), factor.vector.copy()
    at = len(vector) - NUISANCES + LAG
    information[at, at] += sigma_s**-2
    vector[at] += lag_s / sigma_s**2
    return replace(
        factor, information=information, vector=vector, square=factor.square + (lag_s / sigma_s) ** 2
    )


def result_of(factors: list[PassFactor], late_by: Callable[[float], Any] | None) -> DriveResult:
    return DriveResult(SimpleNamespace(), (), {}, tuple(factors), None, late_by)  # type: ignore[arg-type]


def test_factors_are_made_anew_until_the_lag_stands(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    asked: list[float] = []
    said = [late(factor, 4.0) for factor, _ in passes_of(chain(), dict.fromkeys(range(4), (2.0, 0.5)))]

    def late_by(lag_s: float) -> tuple[PassFactor, ...]:
        asked.append(lag_s)
        return tuple(replace(factor, lag_s=lag_s) for factor in said)

    found = with_settled_lag(sessions, uuid.uuid4(), segment_ids, result_of(said, late_by))
    assert asked[0] == LAG_STEP_S  # at most so far at once
    assert found.factors[0].lag_s == asked[-1] == pytest.approx(4.0, abs=0.3)
    assert len(asked) < LAG_ROUNDS
    assert rows_of(sessions, "network_slopes") == {}


def test_a_lag_that_never_stands_ends_all_the_same(
    sessions: Sessions, chain: Chain, segment_ids: Ints, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = [factor for factor, _ in passes_of(chain(), {0: (2.0, 0.5)})]
    monkeypatch.setattr(writing, "lag_among_all", lambda *_: 100.0)
    asked: list[float] = []
    result = result_of(said, lambda lag_s: asked.append(lag_s) or tuple(said))  # type: ignore[func-returns-value]
    with_settled_lag(sessions, uuid.uuid4(), segment_ids, result)
    assert len(asked) == LAG_ROUNDS - 1


def test_drives_without_an_altimeter_are_left_as_they_are(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    said = [factor for factor, _ in passes_of(chain(), {0: (2.0, 0.5)})]
    result = result_of(said, None)
    assert with_settled_lag(sessions, uuid.uuid4(), segment_ids, result) is result


def test_factors_are_made_anew_while_the_terrain_is_open(
    context: JobContext, send: Send, town: Town, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where there is an elevation model, they are made of it as well."""
    monkeypatch.setattr(writing, "lag_among_all", lambda *_: 4.0)
    log = altimeter_gpx(simulate_drive(town, 0, duration_s=90), 4.0).encode()
    drive = send(log, "profile")
    assert process.process_drive(context, drive.id, drive.generation) is Outcome.DONE
