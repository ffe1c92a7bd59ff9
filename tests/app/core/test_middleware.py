"""What is done to every request, whatever its route."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from app.core.middleware import SMALL_BODY_BYTES
from problem_support import check


def test_head_is_get_without_a_body(reading: Any) -> None:
    for path in ("/", "/collections/segments/items", "/tiles.json", "/v1/drives", "/healthz"):
        head, get = reading.client.head(path), reading.client.get(path)
        assert head.status_code == get.status_code == 200
        assert not head.content
        assert head.headers["content-type"] == get.headers["content-type"]


def in_pieces(size: int) -> Iterator[bytes]:
    for _ in range(0, size, 1000):
        yield b" " * 1000


@pytest.mark.parametrize("announced", [True, False])
def test_a_body_that_is_too_large_is_refused_in_the_service_s_words(reading: Any, announced: bool) -> None:
    drive = reading.client.get("/v1/drives").json()["drives"][0]["id"]
    size = SMALL_BODY_BYTES + 1000
    answer = reading.client.post(
        f"/v1/drives/{drive}/reprocess",
        content=b" " * size if announced else in_pieces(size),
        headers={"Content-Type": "application/json"},
    )
    problem = check(answer, 413)
    assert problem["type"] == "/problems/too-large"
    assert problem["detail"] == f"The body is larger than {SMALL_BODY_BYTES} bytes. Send less."


def test_a_body_that_nobody_reads_is_nobody_s_concern(reading: Any) -> None:
    answer = reading.client.request("GET", "/healthz", content=b" " * (SMALL_BODY_BYTES + 1))
    assert answer.status_code == 200
