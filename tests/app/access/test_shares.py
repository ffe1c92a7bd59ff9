"""What the service has so many of in all: one owner does not take all of them."""

from __future__ import annotations

from collections.abc import Callable

import httpx
import pytest

from access_support import Keyed, Things
from problem_support import check

MOST = 6
Shared = tuple[Keyed, dict[str, Things]]
Ask = Callable[[Shared, str, int], httpx.Response]
"""One more of a kind, asked for by that owner; the number makes it another one."""


def export(shared: Shared, caller: str, number: int) -> httpx.Response:
    box = [8.4, 49.0, 8.41 + number / 1000, 49.01]
    return shared[0].ask(caller, "POST", "/v1/exports", json={"format": "csv", "bbox": box})


def trial(shared: Shared, caller: str, number: int) -> httpx.Response:
    path = f"/v1/drives/{shared[1][caller].ids['drive_id']}/trials?option=min_epochs:{5 + number}"
    return shared[0].ask(caller, "POST", path)


def webhook(shared: Shared, caller: str, number: int) -> httpx.Response:
    wish = {"url": f"http://127.0.0.1:9/{number}", "events": ["drive.done"]}
    return shared[0].ask(caller, "POST", "/v1/webhooks", json=wish)


@pytest.mark.parametrize(
    ("place", "ask", "taken", "refused"),
    [
        ("app.exports.store.MOST_WAITING", export, 202, 503),
        ("app.drives.trials.store.MOST_WAITING", trial, 202, 503),
        ("app.changes.webhooks.routes.MOST", webhook, 201, 422),
    ],
)
def test_an_owner_leaves_some_for_others(
    shared: Shared, monkeypatch: pytest.MonkeyPatch, place: str, ask: Ask, taken: int, refused: int
) -> None:
    monkeypatch.setattr(place, MOST)
    # anna and ben have one each. She may have three, where four are held: no more than are left.
    answers = [ask(shared, "anna", number) for number in range(3)]
    assert [answer.status_code for answer in answers] == [taken, taken, refused]
    detail = check(answers[-1], refused)["detail"]
    assert detail.startswith("You have 3 ") or " of yours wait already" in detail
    assert ask(shared, "ben", 0).status_code == taken
    operator = [ask(shared, "operate", 20 + number) for number in range(2)] if ask is not trial else []
    assert [answer.status_code for answer in operator] in ([], [taken, refused]), (
        "whoever operates has the rest"
    )


def test_an_owner_has_but_so_many_keys(guarded: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.access.routes.MOST_KEYS", 4)
    wish = {"label": "another", "scope": "upload"}
    answers = [guarded.ask("anna", "POST", "/v1/keys", json=wish) for _ in range(2)]
    assert answers[0].status_code == 201, "with the fixture's three, of which one is revoked"
    assert check(answers[1], 409)["type"] == "/problems/too-many"
    assert guarded.ask("ben", "POST", "/v1/keys", json=wish).status_code == 201
