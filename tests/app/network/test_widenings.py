"""Repeats are paired as they were driven, and what they show widens the map: learned, applied, taken back."""

from __future__ import annotations

import itertools
import json
import uuid
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from sqlalchemy import text

from app.core.db import Sessions
from app.network.settle import settle_network
from app.network.swap import solve_all_marked
from app.network.widenings import (
    DEVICE_CLASS,
    device_classes,
    learn,
    pairs_of,
    read_repeats,
    repeat_rows,
    reset,
)
from condensed_support import assert_sums_hold
from fusion.network import repeats as learned
from fusion.roads.table import RoadTable
from fusion.types import Ints
from network_support import T0_S, Rows, append, count_of, delete, new_drive, pass_over, passes_of, rows_of

Chain = Callable[..., RoadTable]
DAY_S = 86_400.0
DRIVES = 16


def describe(sessions: Sessions, drive: uuid.UUID, sensors: list[str], altimeter: bool = False) -> None:
    """Give a drive the report of a log with these sensors."""
    report = {"format": "csv", "sensors": {name: {} for name in sensors}, "altimeter": altimeter}
    statement = "UPDATE drives SET report = CAST(:report AS jsonb), drive_time = '2026-01-15' WHERE id = :id"
    with sessions.begin() as session:
        session.execute(text(statement), {"id": drive, "report": json.dumps(report)})


def deployment(sessions: Sessions, table: RoadTable, ids: Ints, error: float) -> list[uuid.UUID]:
    """Drives over six segments whose errors are so many times what they state."""
    rng = np.random.default_rng(4)
    made = []
    for k in range(DRIVES):
        said = {row: (2.0 + 0.5 * error * rng.normal(), 0.5) for row in range(6)}
        made.append(new_drive(sessions))
        append(sessions, made[-1], ids, passes_of(table, said, T0_S + DAY_S * k))
        describe(sessions, made[-1], ["doppler", "altitude"])
    solve_all_marked(sessions)
    settle_network(sessions)
    return made


def settled(sessions: Sessions) -> Rows:
    solve_all_marked(sessions)
    settle_network(sessions)
    return rows_of(sessions)


def sigma_ratio(left: Rows, right: Rows, ids: Ints) -> np.ndarray:
    return np.array([left[i][1] / right[i][1] for i in ids[:6].tolist()])


@pytest.fixture
def doubtful(sessions: Sessions, chain: Chain, segment_ids: Ints) -> list[uuid.UUID]:
    """A deployment whose sigmas are a third of its errors."""
    return deployment(sessions, chain(), segment_ids, 3.0)


def test_what_repeats_contradict_is_widened_and_taken_back(
    sessions: Sessions, segment_ids: Ints, doubtful: list[uuid.UUID]
) -> None:
    before = rows_of(sessions)
    [found] = learn(sessions)
    assert (found["name"], found["drives"], found["drive_pairs"]) == ("doppler, csv", DRIVES, DRIVES - 1)
    assert found["pairs"] == 6 * (DRIVES - 1)
    assert found["applied"] == found["learned"] > 2.0
    assert not found["marking"]
    assert count_of(sessions, "network_marks") > 0
    with sessions() as session:
        own = [row for row in repeat_rows(session) if row["kind"] == "class"]
        pairs = read_repeats(session)
    widened = settled(sessions)
    ratio = sigma_ratio(widened, before, segment_ids)
    assert np.all((ratio > 1.1) & (ratio < found["applied"]))

    [again] = learn(sessions)  # its own statistics are not widened, so nothing changes
    assert {**again, "learned_at": None} == {**found, "learned_at": None}
    assert count_of(sessions, "network_marks") == 0
    with sessions() as session:
        np.testing.assert_array_equal(read_repeats(session).z(), pairs.z())
        assert [row for row in repeat_rows(session) if row["kind"] == "class"] == own
    assert own[0]["widening"] == found["applied"]

    [found] = reset(sessions)
    assert (found["applied"], found["learned"]) == (1.0, again["learned"])
    back = settled(sessions)
    assert sigma_ratio(back, before, segment_ids) == pytest.approx(np.ones(6), rel=1e-6)


def test_a_class_goes_back_to_its_word_when_its_drives_go(
    sessions: Sessions, doubtful: list[uuid.UUID]
) -> None:
    learn(sessions)
    for drive in doubtful[:11]:
        delete(sessions, drive)
    [found] = learn(sessions)
    assert (found["applied"], found["drives"]) == (1.0, 5)
    for drive in doubtful[11:]:
        delete(sessions, drive)
    [found] = learn(sessions)
    assert (found["applied"], found["learned"], found["drives"]) == (1.0, 1.0, 0)


def test_honest_drives_are_taken_at_their_word(sessions: Sessions, chain: Chain, segment_ids: Ints) -> None:
    assert learn(sessions) == []
    deployment(sessions, chain(), segment_ids, 1.0)
    [found] = learn(sessions)
    assert found["applied"] == 1.0
    assert abs(found["learned"] - 1.0) < 3 * found["sigma"]
    assert count_of(sessions, "network_marks") == 0


def test_who_is_interrupted_while_marking_goes_on_later(
    sessions: Sessions, doubtful: list[uuid.UUID]
) -> None:
    def cut_off(stage: str, share: float) -> None:
        if stage == "marking" and count_of(sessions, "network_marks") >= 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        learn(sessions, cut_off)
    with sessions() as session:
        assert [row["marking"] for row in device_classes(session)] == [True]
    marked = count_of(sessions, "network_marks")
    [found] = learn(sessions)
    assert not found["marking"]
    assert count_of(sessions, "network_marks") > marked


@pytest.mark.usefixtures("tiny")
def test_condensed_passes_are_condensed_anew_with_their_widening(
    sessions: Sessions, segment_ids: Ints, doubtful: list[uuid.UUID]
) -> None:
    assert count_of(sessions, "condensed_passes") > 0
    before = rows_of(sessions)
    [found] = learn(sessions)
    widened = settled(sessions)
    assert count_of(sessions, "condensed_passes") > 0
    assert_sums_hold(sessions)
    ratio = sigma_ratio(widened, before, segment_ids)
    assert np.all((ratio > 1.1) & (ratio < 1.1 * found["applied"]))
    reset(sessions)
    assert sigma_ratio(settled(sessions), before, segment_ids) == pytest.approx(np.ones(6), rel=0.05)


def test_pairs_are_of_neighbours_in_time_that_drove_the_whole_segment(
    sessions: Sessions, chain: Chain, segment_ids: Ints
) -> None:
    table, rows = chain(), dict.fromkeys(range(3), (2.0, 0.5))
    forward = passes_of(table, rows, T0_S)
    backward = [
        pass_over(table, row, 2.5, 0.25, begin_s=T0_S + DAY_S, sequence=k) for k, row in enumerate([2, 1, 0])
    ]
    half, estimate = pass_over(table, 0, 9.0, 0.5, begin_s=T0_S + 2 * DAY_S)
    part = [(replace(half, end_m=0.5 * half.end_m), estimate)]
    for made, sensors, altimeter in (
        (forward, ["doppler"], False),
        (backward, ["altitude"], True),
        (part, ["pitch"], False),
    ):
        drive = new_drive(sessions)
        append(sessions, drive, segment_ids, made)
        describe(sessions, drive, sensors, altimeter)
    with sessions() as session:
        pairs = read_repeats(session)
    assert pairs.names == ("altimeter, csv", "doppler, csv", "inertial, csv")
    assert pairs.segment.tolist() == segment_ids[:3].tolist()
    assert pairs.direction.tolist() == [-1, -1, -1]
    assert pairs.classes.tolist() == [[1, 0]] * 3
    assert pairs.z() == pytest.approx(-0.5 / np.hypot(0.5, 0.25))
    assert pairs.speed_mps == pytest.approx(table.length_m[:3] / 5.0, rel=0.01)
    assert pairs.season.tolist() == [[0, 0]] * 3


def test_each_drive_meets_the_one_before_it_and_the_one_of_its_class(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose classes take turns: the last of six is alone on its segment."""
    kinds = ["x", "y", "x", "y", "x", "x"]
    rows = [
        (7 + (k == 5), uuid.UUID(int=k), kind, 1.0 * k, 0.5, 100.0, 1, -1, b"")
        for k, kind in enumerate(kinds)
    ]
    driven = np.tile([0.0, 100.0, 0.0, 10.0], (6, 1))
    pairs = pairs_of(rows, driven)
    assert pairs.drives.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3], [2, 4], [3, 4]]
    assert pairs.segment.tolist() == [7] * 7
    monkeypatch.setattr(learned, "MOST_OF_SEGMENT", 1)
    assert pairs_of(rows, driven).drives.tolist() == [[1, 3], [2, 4], [3, 4]]
    driven[2, 1] = 80.0
    assert [2] not in pairs_of(rows, driven).drives


def test_classes_are_the_same_in_the_database_and_for_logs_at_hand(sessions: Sessions) -> None:
    names = ("doppler", "barometer", "altitude", "pitch", "specific force", "odometer")
    made: dict[uuid.UUID, str] = {}
    for used in itertools.chain.from_iterable(itertools.combinations(names, n) for n in range(4)):
        for altimeter in (False, True):
            drive = new_drive(sessions)
            describe(sessions, drive, list(used), altimeter)
            report = {"format": "csv", "sensors": {name: {} for name in used}, "altimeter": altimeter}
            made[drive] = learned.device_class(report)
    silent = new_drive(sessions)
    with sessions.begin() as session:
        change = text("""UPDATE drives SET report = '{"format": "csv"}' WHERE id = :id""")
        session.execute(change.bindparams(id=silent))
    made[silent] = learned.device_class({"format": "csv"})
    statement = text(f"SELECT id, {DEVICE_CLASS.format('d')} AS name FROM drives AS d")
    with sessions() as session:
        assert {row.id: row.name for row in session.execute(statement)} == made
    assert len(set(made.values())) == 6
