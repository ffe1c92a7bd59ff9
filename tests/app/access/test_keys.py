"""Keys and owners over HTTP: who may make, rotate and revoke which."""

from __future__ import annotations

from typing import Any

import pytest

from access_support import Keyed
from problem_support import check


def make(guarded: Keyed, caller: str, **request: Any) -> Any:
    return guarded.ask(caller, "POST", "/v1/keys", json={"label": "new", "scope": "own", **request})


def test_a_new_key_is_told_once_and_works(guarded: Keyed) -> None:
    answer = make(guarded, "anna")
    assert answer.status_code == 201
    assert answer.headers["cache-control"] == "no-store"
    made = answer.json()
    assert made["secret"].startswith("vsk_")
    assert len(made["secret"]) == 47
    guarded.secrets["new"] = made["secret"]
    assert guarded.ask("new", "GET", "/v1/drives").status_code == 200
    listed = guarded.ask("anna", "GET", "/v1/keys")
    assert made["key"] in listed.json()["keys"] or made["key"]["id"] in listed.text
    assert made["secret"] not in listed.text


def test_an_owner_sees_its_own_keys_and_an_operator_all(guarded: Keyed) -> None:
    mine = guarded.ask("anna", "GET", "/v1/keys").json()["keys"]
    assert {key["owner"]["name"] for key in mine} == {"anna"}
    everything = guarded.ask("operate", "GET", "/v1/keys").json()["keys"]
    assert {key["owner"]["name"] for key in everything} == {"anna", "ben", "operator"}
    of_ben = guarded.ask("operate", "GET", "/v1/keys?owner=ben").json()["keys"]
    assert {key["owner"]["name"] for key in of_ben} == {"ben"}
    check(guarded.ask("anna", "GET", "/v1/keys?owner=ben"), 404)
    check(guarded.ask("operate", "GET", "/v1/keys?owner=nobody"), 404)


@pytest.mark.parametrize(
    ("caller", "request_", "status"),
    [
        ("anna", {"scope": "upload"}, 201),
        ("anna", {"scope": "operate"}, 403),
        ("anna", {"owner": "ben"}, 404),
        ("anna", {"owner": "operator"}, 404),
        ("anna", {"expires_at": "2020-01-01T00:00:00Z"}, 422),
        ("anna", {"expires_at": "2040-01-01T00:00:00"}, 422),
        ("anna", {"label": " "}, 422),
        ("anna", {"label": "x" * 101}, 422),
        ("anna", {"label": "a\nb"}, 422),
        ("anna", {"scope": "all"}, 422),
        ("operate", {"owner": "ben"}, 201),
        ("operate", {"owner": "nobody"}, 404),
        ("operate", {"scope": "operate"}, 201),
    ],
)
def test_what_a_key_may_make(guarded: Keyed, caller: str, request_: dict[str, Any], status: int) -> None:
    answer = make(guarded, caller, **request_)
    assert answer.status_code == status, answer.text


def test_a_rotated_key_has_another_secret_and_the_same_id(guarded: Keyed) -> None:
    path = f"/v1/keys/{guarded.ids['anna upload']}/rotate"
    made = guarded.ask("anna", "POST", path).json()
    assert made["key"]["id"] == str(guarded.ids["anna upload"])
    check(guarded.ask("anna upload", "GET", f"/v1/drives/{guarded.ids['anna']}"), 401)
    guarded.secrets["anna upload"] = made["secret"]
    check(guarded.ask("anna upload", "GET", f"/v1/drives/{guarded.ids['anna']}"), 404)


def test_a_revoked_key_stays_in_the_list_and_is_not_rotated(guarded: Keyed) -> None:
    path = f"/v1/keys/{guarded.ids['anna upload']}"
    for _ in range(2):
        assert guarded.ask("anna", "DELETE", path).status_code == 204
    check(guarded.ask("anna", "POST", f"{path}/rotate"), 404)
    keys = {key["label"]: key for key in guarded.ask("anna", "GET", "/v1/keys").json()["keys"]}
    assert keys["anna upload"]["revoked_at"] is not None


def test_an_owner_changes_no_key_that_may_do_more(guarded: Keyed) -> None:
    path = "/v1/keys"
    made = make(guarded, "operate", scope="operate", owner="anna").json()["key"]
    check(guarded.ask("anna", "DELETE", f"{path}/{made['id']}"), 403)
    check(guarded.ask("anna", "POST", f"{path}/{made['id']}/rotate"), 403)
    for other in ("ben", "operate"):
        check(guarded.ask("anna", "DELETE", f"{path}/{guarded.ids[other]}"), 404)


def test_an_owner_is_made_once(guarded: Keyed) -> None:
    answer = guarded.ask("operate", "POST", "/v1/owners", json={"name": "bus fleet"})
    assert answer.status_code == 201
    assert (answer.json()["name"], answer.json()["keys"], answer.json()["drives"]) == ("bus fleet", 0, 0)
    problem = check(guarded.ask("operate", "POST", "/v1/owners", json={"name": "bus fleet"}), 409)
    assert problem["type"] == "/problems/conflict"
    owners = guarded.ask("operate", "GET", "/v1/owners").json()["owners"]
    assert [owner["name"] for owner in owners] == ["anna", "ben", "bus fleet", "operator"]


def test_changes_are_in_the_audit(guarded: Keyed) -> None:
    made = make(guarded, "anna").json()["key"]["id"]
    guarded.ask("anna", "POST", f"/v1/keys/{made}/rotate")
    guarded.ask("anna", "DELETE", f"/v1/keys/{made}")
    rows = guarded.ask("operate", "GET", "/v1/admin/audit?days=1").text
    for action in ("key made", "key rotated", "key revoked"):
        assert action in rows
