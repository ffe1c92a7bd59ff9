"""The benchmark of phones, small: nothing is lost when all processes of the service are killed."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from accuracy.arguments import REPOSITORY
from app.core.settings.places import libpq_url
from service.live_load import Told, measured, rows_of
from service.live_phones import batch
from service.processes import Service


@pytest.mark.long("ten seconds of a service whose processes are killed")
def test_no_point_is_lost_when_the_service_is_killed(database_url: str, tmp_path: Path) -> None:
    service = Service(REPOSITORY, libpq_url(database_url), tmp_path)
    args = argparse.Namespace(devices=60, minutes=0.1, every=3.0, points=5, apis=1, kills=1, closed=20)
    rows, outcome = measured(args, service, tmp_path)
    assert (outcome.lost, outcome.twice, outcome.in_no_log) == (0, 0, 0)
    assert (outcome.points_sent, outcome.devices) == (600, 60)
    assert outcome.failed
    assert rows[0]["sent"] >= 120


def test_what_was_asked_soon_after_a_kill_is_told_apart() -> None:
    told = Told([(1.0, 0.01, 0.0), (21.0, 3.0, 0.0), (60.0, 0.02, 0.001)], kills_s=[20.0])
    everything, up = rows_of(told)
    assert (everything["sent"], everything["max_ms"]) == (3, 3000.0)
    assert (up["sent"], round(up["max_ms"])) == (2, 20)


def test_batches_of_a_device_go_on_where_the_one_before_ended() -> None:
    first, second = batch(3, 0, 2, 1_700_000_000), batch(3, 1, 2, 1_700_000_000)
    assert first.count(b'"Point"') == 2
    assert b'"timestamp": 1700000005.0' in first
    assert b'"timestamp": 1700000010.0' in second
