"""Clients of the OGC API that nobody here wrote: each reads all there is, with the types of the contract."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pyogrio
import pytest

from app.core.settings.places import libpq_url
from clients import features
from clients.truth import EXPECTED_KINDS, Truth


@pytest.fixture(scope="module")
def elsewhere() -> Iterator[ProcessPoolExecutor]:
    """A process beside this one: GDAL keeps Python's lock while it waits, and the service runs in this process."""
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        yield pool


@pytest.fixture
def truth(reading: Any) -> Truth:
    return Truth(libpq_url(reading.settings.database_url))


@pytest.mark.parametrize("client", [features.in_pyogrio, features.owslib])
def test_a_client_reads_every_segment_as_it_is(
    client: Any, reading: Any, truth: Truth, elsewhere: ProcessPoolExecutor, tmp_path: Path
) -> None:
    got = elsewhere.submit(features.complete, client, reading.base, tmp_path).result(60)
    result = truth.judged("client", got)
    assert len(truth) > 2 * reading.settings.items_limit_max, "several pages"
    assert result.features == len(truth)
    assert result.equal, truth.difference(got)
    assert result.wrong_kinds == {}
    # What is wrong would be seen.
    rows = [dict(row) for row in got.rows]
    rows[3]["length_m"] += 0.002
    assert not truth.judged("client", replace(got, rows=rows)).equal
    assert "client: " in truth.difference(replace(got, rows=rows))
    assert truth.judged("client", replace(got, rows=rows[1:])).features == len(truth) - 1


def test_gdal_is_told_of_types_that_a_first_page_does_not_show(
    reading: Any, elsewhere: ProcessPoolExecutor
) -> None:
    """Numbers of nodes exceed 32 bits on real maps, and the first slopes may all be unknown."""
    info = elsewhere.submit(pyogrio.read_info, f"OAPIF:{reading.base}", layer="segments").result(60)
    types = dict(zip(info["fields"], info["ogr_types"], strict=True))
    assert {types[name] for name in ("osm_way_id", "from_node", "to_node")} == {"OFTInteger64"}
    assert {types[name] for name, kind in EXPECTED_KINDS.items() if kind == "number"} == {"OFTReal"}
    assert types["updated_at"] == "OFTDateTime"
