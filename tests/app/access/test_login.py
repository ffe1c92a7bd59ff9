"""Sessions of browsers: how they begin, what they are good for, how they end."""

from __future__ import annotations

import statistics
import time
from datetime import timedelta
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from access_support import Keyed
from app.access import store
from app.access.sessions import LOGINS
from app.core.settings import Settings
from problem_support import check
from server_support import wait_until
from web_fixtures import TLS, served

ORIGIN = "http://elsewhere.example"


def browser(guarded: Keyed) -> httpx.Client:
    """A client that keeps cookies and says where its changes come from, as browsers do."""
    base = guarded.web.base
    return httpx.Client(
        base_url=base, trust_env=False, verify=TLS, headers={"Origin": base, "Sec-Fetch-Mode": "cors"}
    )


def cookies(client: httpx.Client) -> dict[str, str]:
    return dict(client.cookies)


def log_in(client: httpx.Client, **what: str) -> httpx.Response:
    return client.post("/v1/session", json=what)


def a_link(guarded: Keyed, caller: str = "anna", **valid: Any) -> str:
    with guarded.web.sessions.begin() as session:
        return store.create_link(session, guarded.ids[caller], **valid)


def test_a_key_logs_a_browser_in_until_it_logs_out(guarded: Keyed) -> None:
    with browser(guarded) as client:
        nobody = client.get("/v1/session").json()
        assert (nobody["access"], nobody["public_map"], nobody["scope"], nobody["owner"]) == (
            "keys",
            "off",
            None,
            None,
        )
        check(client.get("/v1/drives"), 401)
        answer = log_in(client, key=guarded.secrets["anna"])
        assert answer.status_code == 200
        assert answer.json()["owner"] == {"id": guarded.owners["anna"], "name": "anna"}
        assert answer.json()["scope"] == "own"
        assert answer.headers["cache-control"] == "no-store"
        cookie = answer.headers["set-cookie"]
        assert "HttpOnly" in cookie
        assert "SameSite=lax" in cookie
        assert "Max-Age=43200" in cookie
        assert client.get("/v1/session").json() == answer.json()
        assert client.get("/v1/drives").status_code == 200
        kept = cookies(client)
        assert client.delete("/v1/session").status_code == 204
        assert cookies(client) == {}
        check(client.get("/v1/drives"), 401)
        client.cookies.update(kept)  # somebody noted the cookie before
        check(client.get("/v1/drives"), 401)


def test_by_https_the_cookie_is_this_hosts_alone(settings: Settings) -> None:
    proxied = settings.model_copy(update={"access": "keys", "trusted_proxies": "127.0.0.1"})
    with served(proxied) as web:
        with web.sessions.begin() as session:
            _, secret = store.create_key(session, 1, "browser", "own")
        headers = {"X-Forwarded-Proto": "https"}
        answer = web.client.post("/v1/session", json={"key": secret}, headers=headers)
        cookie = answer.headers["set-cookie"]
        assert cookie.startswith("__Host-versant=")
        assert "; Secure" in cookie
        assert "Path=/" in cookie
        assert "Domain" not in cookie
        shown = {**headers, "Cookie": cookie.partition(";")[0]}
        assert web.client.get("/v1/drives", headers=shown).status_code == 200
        plain = {"Cookie": shown["Cookie"]}
        assert web.client.get("/v1/drives", headers=plain).status_code == 401


@pytest.mark.parametrize("caller", ["wrong", "revoked"])
def test_a_key_that_is_none_logs_nobody_in(guarded: Keyed, caller: str) -> None:
    with browser(guarded) as client:
        problem = check(log_in(client, key=guarded.secrets[caller]), 401)
        assert problem["type"] == "/problems/unauthorized"
        assert cookies(client) == {}


def test_a_key_that_only_uploads_logs_nobody_in(guarded: Keyed) -> None:
    with browser(guarded) as client:
        check(log_in(client, key=guarded.secrets["anna upload"]), 403)
        assert cookies(client) == {}


def test_a_link_logs_in_once(guarded: Keyed) -> None:
    link = a_link(guarded)
    with browser(guarded) as first, browser(guarded) as second:
        assert log_in(first, link=link).json()["owner"]["name"] == "anna"
        assert "used already" in check(log_in(second, link=link), 401)["detail"]
        assert first.get("/v1/drives").status_code == 200
        check(second.get("/v1/drives"), 401)


def test_a_link_that_is_old_or_of_a_revoked_key_logs_nobody_in(guarded: Keyed) -> None:
    old = a_link(guarded, valid=timedelta(seconds=-1))
    with browser(guarded) as client:
        check(log_in(client, link=old), 401)
        link = a_link(guarded)
        guarded.ask("operate", "DELETE", f"/v1/keys/{guarded.ids['anna']}")
        check(log_in(client, link=link), 401)


def test_a_session_of_somebody_else_is_not_taken_over(guarded: Keyed) -> None:
    """Fixation: who plants a cookie in a browser knows no session that it later has."""
    with browser(guarded) as attacker, browser(guarded) as client:
        log_in(attacker, key=guarded.secrets["ben"])
        planted = cookies(attacker)
        ((name, secret),) = planted.items()
        client.cookies.set(name, secret, domain="127.0.0.1")
        assert client.get("/v1/session").json()["owner"]["name"] == "ben"
        log_in(client, key=guarded.secrets["anna"])
        assert client.cookies[name] != secret
        assert client.get("/v1/session").json()["owner"]["name"] == "anna"
        assert attacker.get("/v1/session").json()["owner"]["name"] == "ben"


@pytest.mark.parametrize("change", [{"revoked_at": "now()"}, {"expires_at": "now() - interval '1 second'"}])
def test_a_session_ends_with_its_key(guarded: Keyed, change: dict[str, str]) -> None:
    with browser(guarded) as client:
        log_in(client, key=guarded.secrets["anna"])
        assert client.get("/v1/drives").status_code == 200
        (column, value), *_ = change.items()
        with guarded.web.sessions.begin() as session:
            session.execute(
                text(f"UPDATE keys SET {column} = {value} WHERE id = :id"), {"id": guarded.ids["anna"]}
            )
        wait_until(lambda: client.get("/v1/drives").status_code == 401)


def test_a_session_ends_when_its_key_is_rotated(guarded: Keyed) -> None:
    with browser(guarded) as client:
        log_in(client, key=guarded.secrets["anna"])
        link = a_link(guarded)
        assert client.post(f"/v1/keys/{guarded.ids['anna']}/rotate").status_code == 200
        check(client.get("/v1/drives"), 401)
        check(log_in(client, link=link), 401)


def test_a_session_ends_by_itself(guarded: Keyed) -> None:
    with browser(guarded) as client:
        log_in(client, key=guarded.secrets["anna"])
        with guarded.web.sessions.begin() as session:
            session.execute(text("UPDATE sessions SET expires_at = now() - interval '1 second'"))
        check(client.get("/v1/drives"), 401)


def test_a_page_of_another_site_changes_nothing_by_a_visitors_session(guarded: Keyed) -> None:
    """Neither where the browser names it, nor where nothing is said of where the request comes from."""
    with browser(guarded) as client:
        log_in(client, key=guarded.secrets["anna"])
        for headers in ({"Origin": ORIGIN}, {"Origin": "null"}, {"Sec-Fetch-Site": "cross-site"}):
            bare = {**dict.fromkeys(("Origin",), headers.get("Origin", "")), **headers}
            if not bare["Origin"]:
                del bare["Origin"]
            with httpx.Client(
                base_url=guarded.web.base, trust_env=False, verify=TLS, cookies=client.cookies
            ) as other:
                answer = other.post("/v1/keys", json={"label": "x", "scope": "own"}, headers=bare)
                assert check(answer, 403)["type"] == "/problems/cross-origin-write"
        with httpx.Client(
            base_url=guarded.web.base, trust_env=False, verify=TLS, cookies=client.cookies
        ) as silent:
            check(silent.post("/v1/keys", json={"label": "x", "scope": "own"}), 403)
            assert silent.get("/v1/keys").status_code == 200
        keys = client.get("/v1/keys").json()["keys"]
        assert "x" not in {key["label"] for key in keys}


def test_a_page_of_another_site_logs_nobody_in(guarded: Keyed) -> None:
    headers = {"Origin": ORIGIN}
    answer = guarded.web.client.post("/v1/session", json={"key": guarded.secrets["ben"]}, headers=headers)
    check(answer, 403)


def test_whoever_tries_again_and_again_has_to_wait(guarded: Keyed) -> None:
    for _ in range(LOGINS.amount):
        check(guarded.web.client.post("/v1/session", json={"key": store.new_key()}), 401)
    answer = guarded.web.client.post("/v1/session", json={"key": guarded.secrets["anna"]})
    assert check(answer, 429)["type"] == "/problems/too-often"
    assert 0 < int(answer.headers["retry-after"]) <= 60
    assert guarded.ask("anna", "GET", "/v1/drives").status_code == 200  # who sends its key goes on


def test_the_time_of_an_answer_tells_no_key(guarded: Keyed) -> None:
    """A key that is nearly right takes as long as one that is not: they are looked up by their hashes."""
    near = guarded.secrets["anna"][:-1] + ("A" if guarded.secrets["anna"][-1] != "A" else "B")
    guarded.secrets["near"] = near
    took: dict[str, list[float]] = {"near": [], "wrong": []}
    for _ in range(60):
        for caller, times in took.items():
            begin = time.perf_counter()
            assert guarded.ask(caller, "GET", "/v1/drives").status_code == 401
            times.append(time.perf_counter() - begin)
    near_s, wrong_s = (statistics.median(times) for times in took.values())
    assert 0.5 < near_s / wrong_s < 2.0


@pytest.mark.parametrize("body", [{}, {"key": "a", "link": "b"}, {"key": None}])
def test_a_login_is_by_one_of_both(guarded: Keyed, body: dict[str, Any]) -> None:
    check(guarded.web.client.post("/v1/session", json=body), 422)


def test_no_secret_is_kept(guarded: Keyed) -> None:
    with browser(guarded) as client:
        log_in(client, key=guarded.secrets["anna"])
        link = a_link(guarded)
        secrets = [*guarded.secrets.values(), *cookies(client).values(), link]
        with guarded.web.sessions() as session:
            for table in ("keys", "sessions", "login_links", "audit_log"):
                rows = str(session.execute(text(f"SELECT * FROM {table}")).all())
                assert not any(secret in rows or secret.removeprefix("vsk_") in rows for secret in secrets)
