"""Lists of drives through HTTP: every order, filter and page size against Python's own sorting."""

from __future__ import annotations

import random
import re
import uuid
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sqlalchemy import text

BEGIN = datetime(2026, 11, 20, tzinfo=UTC)
WORDS = (
    "Karlsruhe",
    "monday",
    "LOG",
    "log",
    "drive-3",
    "2026-11-20",
    "a_b",
    "20261120",
    "straße",
    "%",
    "'x'",
)
STATUSES = ("queued", "running", "done", "failed", "cancelled")
_INSERT = text(
    """
    INSERT INTO drives (id, sha256, filename, size_bytes, blob_key, status, method, options, created_at, drive_time,
                        distance_m, failure_kind)
    VALUES (:id, :id, :filename, 1, 'k', :status, 'raw', '{}', :created_at, :drive_time, :distance_m, :failure)
    """
)

Row = dict[str, Any]


def make_rows(seed: int, count: int) -> list[Row]:
    """Drives with few different values, so that many are alike, and with unknown ones."""
    draw = random.Random(seed)  # noqa: S311 - nothing secret
    rows = []
    for _ in range(count):
        status = draw.choice(STATUSES)
        rows.append(
            {
                "id": uuid.UUID(int=draw.getrandbits(128)),
                "filename": " ".join(draw.choices(WORDS, k=draw.randint(1, 3))) + draw.choice(["", ".csv"]),
                "status": status,
                "created_at": BEGIN + timedelta(microseconds=draw.randint(0, 20)),
                "drive_time": draw.choice([None, BEGIN - timedelta(days=draw.randint(0, 3))]),
                "distance_m": draw.choice([None, 0.0, 0.1, 0.1 + 2e-17, 1 / 3, 1e7]),
                "failure": draw.choice(["no-match", "empty-log"]) if status == "failed" else None,
            }
        )
    return rows


@pytest.fixture
def rows(web: Any) -> list[Row]:
    made = make_rows(7, 60)
    with web.sessions.begin() as session:
        session.execute(_INSERT, made)
    return made


def words_of(name: str) -> list[str]:
    return re.findall(r"[0-9]+|[^\W\d_]+", name.lower())


def named(row: Row, q: str) -> bool:
    return all(any(word.startswith(part) for word in words_of(row["filename"])) for part in words_of(q))


def in_order(rows: list[Row], sort: str, *, descending: bool) -> list[str]:
    """Known keys in order, then unknown ones, each by time and id."""

    def key(row: Row) -> Any:
        return row["filename"].lower().encode()[:] if sort == "filename" else row[sort]

    known = [row for row in rows if key(row) is not None]
    unknown = [row for row in rows if key(row) is None]
    known.sort(key=lambda row: (key(row), row["created_at"], row["id"].int), reverse=descending)
    unknown.sort(key=lambda row: (row["created_at"], row["id"].int), reverse=descending)
    return [str(row["id"]) for row in known + unknown]


def link_to(page: dict[str, Any], rel: str) -> str | None:
    return next((link["href"] for link in page["links"] if link["rel"] == rel), None)


SORTS = ("created_at", "drive_time", "distance_m", "filename", "status")
FILTERS: list[tuple[dict[str, str], Callable[[Row], bool]]] = [
    ({}, lambda row: True),
    ({"status": "failed"}, lambda row: row["status"] == "failed"),
    ({"failure": "no-match"}, lambda row: row["failure"] == "no-match"),
    ({"q": "lo"}, lambda row: named(row, "lo")),
    ({"q": "Karl 2026"}, lambda row: named(row, "karl 2026")),
    ({"q": "2026-11"}, lambda row: named(row, "2026 11")),
    ({"q": "straß", "status": "done"}, lambda row: named(row, "straß") and row["status"] == "done"),
    (
        {"created_after": "2026-11-20T00:00:00.000005Z", "created_before": "2026-11-20T00:00:00.000015Z"},
        lambda row: timedelta(microseconds=5) <= row["created_at"] - BEGIN < timedelta(microseconds=15),
    ),
]


def test_every_order_and_filter_as_python_sorts_and_pages_lead_there_and_back(
    web: Any, rows: list[Row]
) -> None:
    @given(
        st.sampled_from(SORTS), st.sampled_from([None, "asc", "desc"]), st.sampled_from(FILTERS), st.data()
    )
    @settings(suppress_health_check=list(HealthCheck), max_examples=40)
    def check(sort: str, order: str | None, chosen: Any, data: st.DataObject) -> None:
        parameters, keeps = chosen
        limit = data.draw(st.sampled_from([1000, 60, 7, 13]))
        asked = {"sort": sort, "limit": limit, **parameters} | ({"order": order} if order else {})
        descending = order == "desc" or (order is None and sort not in ("filename", "status"))
        expected = in_order(
            [row for row in rows if keeps(row) and row["status"] != "cancelled"], sort, descending=descending
        )
        pages: list[list[str]] = []
        answer = web.client.get("/v1/drives", params=asked)
        while True:
            assert answer.status_code == 200, answer.text
            page = answer.json()
            pages.append([drive["id"] for drive in page["drives"]])
            following = link_to(page, "next")
            if following is None:
                break
            answer = web.client.get(following)
        assert [drive for one in pages for drive in one] == expected
        back = link_to(page, "prev")
        for one in reversed(pages[:-1]):
            assert back is not None
            page = web.client.get(back).json()
            assert [drive["id"] for drive in page["drives"]] == one
            back = link_to(page, "prev")

    check()


def test_a_drive_by_its_id(web: Any, rows: list[Row]) -> None:
    for row in [row for row in rows if row["status"] != "cancelled"][:5]:
        for said in (str(row["id"]), row["id"].hex, str(row["id"])[:8].upper(), f" {str(row['id'])[:13]} "):
            found = web.client.get("/v1/drives", params={"q": said}).json()["drives"]
            assert str(row["id"]) in [drive["id"] for drive in found]


@pytest.mark.parametrize("q", ["zebra", "&|!:*()", "\\", "' OR true --", "\x00", "😀", "x" * 100, "12345678"])
def test_a_search_for_what_is_not_there(web: Any, rows: list[Row], q: str) -> None:
    answer = web.client.get("/v1/drives", params={"q": q})
    assert answer.status_code == 200, answer.text
    assert [d for d in answer.json()["drives"] if not named_or_of(q, d)] == []


def named_or_of(q: str, drive: dict[str, Any]) -> bool:
    return any(part in drive["filename"].lower() for part in words_of(q))


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ("sort=colour", "sort"),
        ("order=up", "order"),
        ("q=", "q"),
        (f"q={'x' * 101}", "q"),
        ("after=nonsense", "after"),
        ("sort=filename&after=nonsense", "after"),
        ("sort=filename&after=" + "A" * 2000, "after"),
        ("sort=status&before=W10=", "before"),
        ("sort=distance_m&after=" + "bnVsbA==", "after"),
        ("before=AAAA&after=AAAA", "before"),
        ("created_before=yesterday", "created_before"),
    ],
)
def test_what_cannot_be_asked(web: Any, query: str, field: str) -> None:
    answer = web.client.get(f"/v1/drives?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == field


def test_a_place_of_one_order_is_none_of_another(web: Any, rows: list[Row]) -> None:
    page = web.client.get("/v1/drives?sort=filename&limit=3").json()
    following = link_to(page, "next")
    assert following is not None
    for sort in ("status", "drive_time", "distance_m", "created_at"):
        answer = web.client.get(following.replace("sort=filename", f"sort={sort}"))
        assert answer.status_code == 422
        assert "next or prev" in answer.json()["detail"] or "next link" in answer.json()["detail"]
