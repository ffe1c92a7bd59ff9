"""Whose exports a caller sees, and that the same request of two owners is made for each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from access_support import Holder, Keyed
from app.exports import store
from problem_support import check

BODY = {"format": "csv"}
Work = Callable[..., list[str]]


def ask(holder: Holder, status: int = 202) -> str:
    answer = holder.post("/v1/exports", json=BODY)
    assert answer.status_code == status, answer.text
    return str(answer.json()["id"])


def test_each_owner_has_its_own(keyed_filled: Keyed, work: Work) -> None:
    keyed = keyed_filled
    of_a = ask(keyed.a.own)
    assert ask(keyed.a.own) == of_a
    of_b, of_operator = ask(keyed.b.own), ask(keyed.operator)
    assert len({of_a, of_b, of_operator}) == 3
    assert work(keyed.web) == ["done"] * 3
    assert ask(keyed.a.own, 200) == of_a
    assert ask(keyed.operator, 200) == of_operator
    lists = [
        holder.get("/v1/exports").json()["exports"] for holder in (keyed.a.own, keyed.b.own, keyed.operator)
    ]
    assert [[one["id"] for one in found] for found in lists] == [[of_a], [of_b], [of_operator, of_b, of_a]]
    for path in ("", "/file", "/beside/versant-csv.csv.json"):
        assert check(keyed.b.own.get(f"/v1/exports/{of_a}{path}"), 404)
    check(keyed.b.own.delete(f"/v1/exports/{of_a}"), 404)
    check(keyed.a.upload.get(f"/v1/exports/{of_a}"), 403)
    check(keyed.web.client.get(f"/v1/exports/{of_a}"), 401)
    assert keyed.a.own.get(f"/v1/exports/{of_a}/file").status_code == 200
    assert keyed.b.own.delete(f"/v1/exports/{of_b}").status_code == 204
    assert keyed.a.own.get(f"/v1/exports/{of_a}/file").status_code == 200


def test_so_many_wait_at_most_of_all_owners(keyed_filled: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    keyed = keyed_filled
    monkeypatch.setattr(store, "MOST_WAITING", 2)
    ask(keyed.a.own)
    ask(keyed.operator)
    problem: dict[str, Any] = check(keyed.b.own.post("/v1/exports", json=BODY), 503)
    assert "2 exports wait already" in problem["detail"]
