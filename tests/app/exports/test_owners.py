"""Whose exports a caller sees, and that the same request of two owners is made for each."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from typing import Any

import pytest

from access_support import Holder, Keyed
from app.exports import store
from app.exports.run import EXPORT
from app.jobs.context import JobContext
from app.jobs.requests.upkeep import look_after
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


def boxed(number: int) -> dict[str, Any]:
    """A request unlike that of another number, for a file of the same size."""
    return BODY | {"bbox": [8.39 - number / 1000, 48.99, 8.41, 49.02]}


def test_so_many_of_an_owner_are_under_way_at_most(keyed_filled: Keyed) -> None:
    keyed, most = keyed_filled, keyed_filled.web.settings.quota_exports
    asked = [keyed.a.own.post("/v1/exports", json=boxed(k)).json()["id"] for k in range(most)]
    with keyed.web.sessions.begin() as session:
        assert store.exports.claim(session, uuid.UUID(asked[0])) is not None
    refused = keyed.a.own.post("/v1/exports", json=boxed(most))
    problem = check(refused, 429)
    assert problem["type"] == "/problems/quota" and f"You may have {most} exports" in problem["detail"]
    assert int(refused.headers["retry-after"]) > 0
    assert keyed.a.own.post("/v1/exports", json=boxed(1)).json()["id"] == asked[1], "the same one is no other"
    assert ask(keyed.b.own)
    operators = [keyed.operator.post("/v1/exports", json=boxed(k)).status_code for k in range(most + 1)]
    assert operators == [202] * (most + 1)
    assert keyed.a.own.delete(f"/v1/exports/{asked[2]}").status_code == 204
    assert keyed.a.own.post("/v1/exports", json=boxed(most)).status_code == 202


def test_files_of_an_owner_push_out_its_own_alone(keyed_filled: Keyed, work: Work) -> None:
    """Those of before are another owner's and, more than one may have, an operator's."""
    keyed = keyed_filled
    before = [(keyed.b.own, 0), *((keyed.operator, k) for k in range(3))]
    asked = [*before, *((keyed.a.own, k) for k in range(4))]
    ids = [holder.post("/v1/exports", json=boxed(k)).json()["id"] for holder, k in asked]
    assert set(work(keyed.web)) == {"done"}

    def kept() -> dict[str, int]:
        return {one["id"]: one["size_bytes"] for one in keyed.operator.get("/v1/exports").json()["exports"]}

    (size,) = set(kept().values())
    bounds = {"exports_max_bytes": 6 * size, "exports_owner_bytes": 2 * size}
    look_after(EXPORT, JobContext(keyed.web.settings.model_copy(update=bounds), keyed.web.sessions))
    assert set(kept()) == {*ids[:4], *ids[6:]}


def test_a_file_that_an_owner_has_no_room_for_fails(keyed_filled: Keyed, work: Work) -> None:
    keyed = keyed_filled
    of_a, of_operator = ask(keyed.a.own), ask(keyed.operator)
    assert sorted(work(keyed.web, exports_owner_bytes=100)) == ["done", "failed"]
    failure = keyed.a.own.get(f"/v1/exports/{of_a}").json()["failure"]
    assert failure["kind"] == "too-large" and "VERSANT_EXPORTS_OWNER_BYTES" in failure["reason"]
    assert keyed.operator.get(f"/v1/exports/{of_operator}").json()["status"] == "done"


def test_so_many_wait_at_most_of_all_owners(keyed_filled: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    keyed = keyed_filled
    monkeypatch.setattr(store, "MOST_WAITING", 2)
    ask(keyed.a.own)
    ask(keyed.operator)
    problem: dict[str, Any] = check(keyed.b.own.post("/v1/exports", json=BODY), 503)
    assert "2 exports wait already" in problem["detail"]
