"""Clients of the OGC API that nobody here wrote: each reads all there is, with the types of the contract."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyogrio
import pytest

from app.core.settings import libpq_url
from clients import features
from clients.truth import EXPECTED_KINDS, Truth


@pytest.fixture
def truth(reading: Any) -> Truth:
    return Truth(libpq_url(reading.settings.database_url))


@pytest.mark.parametrize("client", [features.in_pyogrio, features.owslib])
def test_a_client_reads_every_segment_as_it_is(
    client: Any, reading: Any, truth: Truth, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(features, "PAGE", reading.settings.items_limit_max)
    got = client(reading.base, tmp_path)
    got.rows = list(got.rows)
    verdict = truth.judged("client", got)
    assert len(truth) > 2 * reading.settings.items_limit_max, "several pages"
    assert verdict.features == len(truth)
    assert verdict.equal, truth.difference(got)
    assert verdict.wrong_kinds == {}


def test_gdal_is_told_of_types_that_a_first_page_does_not_show(reading: Any) -> None:
    """Numbers of nodes exceed 32 bits on real maps, and the first slopes may all be unknown."""
    info = pyogrio.read_info(f"OAPIF:{reading.base}", layer="segments")
    types = dict(zip(info["fields"], info["ogr_types"], strict=True))
    assert {types[name] for name in ("osm_way_id", "from_node", "to_node")} == {"OFTInteger64"}
    real = {name for name, kind in EXPECTED_KINDS.items() if kind == "number"}
    assert {types[name] for name in real} == {"OFTReal"}
    assert types["updated_at"] == "OFTDateTime"


def test_a_wrong_value_is_seen(truth: Truth, reading: Any, tmp_path: Path) -> None:
    got = features.in_pyogrio(reading.base, tmp_path)
    rows = [dict(row) for row in got.rows]
    rows[3]["length_m"] += 0.002
    got.rows = rows
    assert not truth.judged("client", got).equal
    assert "client: " in truth.difference(got)
    got.rows = rows[:-1]
    assert truth.judged("client", got).features == len(truth) - 1
