"""Logins by a provider (OpenID Connect), a real one on a port of its own, and by a proxy that has checked who asks."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import httpx
import pytest
from pydantic import SecretStr
from sqlalchemy import text

from app.core.settings import Settings, SettingsError, load_settings
from problem_support import check
from web_fixtures import TLS, Web, served

SHARED = "between us"
CLIENT: dict[str, Any] = {"oidc_client_id": "versant", "oidc_client_secret": SecretStr(SHARED)}
PEOPLE: dict[str, dict[str, Any]] = {
    "anna": {"fleet": "bus fleet", "roles": ["driver"]},
    "olga": {"fleet": "office", "roles": ["driver", "boss"]},
    "eve": {"fleet": "operator"},
    "nemo": {},
}


@pytest.fixture(scope="module")
def issuer() -> Iterator[str]:
    """A provider of logins, which knows some people, in a process of its own."""
    people = [f"--user-claims={json.dumps({'sub': name, **claims})}" for name, claims in PEOPLE.items()]
    command = [sys.executable, "-m", "oidc_provider_mock", "--port", "0", *people]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        try:
            address = next(
                found for line in process.stderr if (found := re.search(r"http://127[.0-9]+:(\d+)", line))
            )
            drain = threading.Thread(
                target=process.stderr.read, daemon=True
            )  # else it stops when the pipe is full
            drain.start()
            yield f"http://127.0.0.1:{address[1]}"
        finally:
            process.terminate()
            drain.join(20)


@pytest.fixture
def web(settings: Settings, issuer: str) -> Iterator[Web]:
    """A service that lets this provider say who it is."""
    chosen = {
        **CLIENT,
        "oidc_issuer": issuer,
        "access": "keys",
        "oidc_owner_claim": "fleet",
        "oidc_operate_role": "boss",
    }
    with served(settings.model_copy(update=chosen)) as running:
        yield running


def browser(web: Web) -> httpx.Client:
    return httpx.Client(base_url=web.base, trust_env=False, verify=TLS)


def at_the_provider(address: str, person: str) -> str:
    """Log in there; returns where it sends the browser."""
    with httpx.Client(trust_env=False, verify=TLS) as client:
        answer = client.post(address, data={"sub": person})
        assert answer.status_code in {302, 303}, answer.text
        return str(answer.headers["location"])


def log_in(client: httpx.Client, person: str, return_to: str = "/drives") -> httpx.Response:
    begun = client.get("/v1/session/oidc", params={"return_to": return_to})
    assert begun.status_code == 303, begun.text
    return client.get(at_the_provider(begun.headers["location"], person))


def test_a_login_gives_a_session_of_the_owner_that_the_provider_names(web: Web) -> None:
    with browser(web) as client:
        assert client.get("/v1/session").json()["login_provider"] is True
        answer = log_in(client, "anna", "/drives?x=1")
        assert (answer.status_code, answer.headers["location"]) == (303, f"{web.base}/drives?x=1")
        document = client.get("/v1/session").json()
        assert (document["scope"], document["owner"]["name"], document["key"]) == ("own", "bus fleet", None)
        assert client.get("/v1/drives").status_code == 200
        check(client.get("/v1/operations"), 403)
        again = document["owner"]["id"]
        assert client.delete("/v1/session", headers={"Origin": web.base}).status_code == 204
        log_in(client, "anna")
        assert client.get("/v1/session").json()["owner"]["id"] == again


def test_a_role_lets_operate(web: Web) -> None:
    with browser(web) as client:
        log_in(client, "olga")
        assert client.get("/v1/session").json()["scope"] == "operate"
        assert client.get("/v1/operations").status_code == 200


@pytest.mark.parametrize("person", ["eve", "nemo"])
def test_nobody_becomes_the_operator_by_name_nor_anybody_without_one(web: Web, person: str) -> None:
    with browser(web) as client:
        answer = log_in(client, person)
        assert answer.headers["location"] == f"{web.base}/login?failed=provider"
        assert client.get("/v1/session").json()["owner"] is None


def test_a_login_that_began_in_another_browser_is_refused(web: Web) -> None:
    """Else somebody could log a visitor in as himself, and read what the visitor then uploads."""
    with browser(web) as attacker, browser(web) as client:
        begun = attacker.get("/v1/session/oidc")
        back = at_the_provider(begun.headers["location"], "anna")
        answer = client.get(back)
        assert answer.headers["location"] == f"{web.base}/login?failed=provider"
        client.get("/v1/session/oidc")  # with a login of its own under way
        assert client.get(back).headers["location"] == f"{web.base}/login?failed=provider"
        assert client.get("/v1/session").json()["owner"] is None


def test_a_code_is_good_once_and_for_its_own_attempt(web: Web) -> None:
    with browser(web) as client:
        begun = client.get("/v1/session/oidc")
        back = at_the_provider(begun.headers["location"], "anna")
        cookie = dict(client.cookies)
        assert client.get(back).headers["location"] == f"{web.base}/drives"
        client.cookies.clear()
        for name, value in cookie.items():
            client.cookies.set(name, value, domain="127.0.0.1")
        assert client.get(back).headers["location"] == f"{web.base}/login?failed=provider"
        other = client.get("/v1/session/oidc")
        state = parse_qs(urlsplit(other.headers["location"]).query)["state"][0]
        stolen = parse_qs(urlsplit(back).query)["code"][0]
        mixed = f"{urlsplit(back)._replace(query=urlencode({'code': stolen, 'state': state})).geturl()}"
        assert client.get(mixed).headers["location"] == f"{web.base}/login?failed=provider"


@pytest.mark.parametrize(
    "address",
    [
        "https://elsewhere.example",
        "//elsewhere.example",
        "/\\elsewhere.example",
        "drives",
        "",
        "/a;b",
        "/a\r\nX: y",
    ],
)
def test_nobody_is_led_to_another_site(web: Web, address: str) -> None:
    with browser(web) as client:
        assert log_in(client, "anna", address).headers["location"] == f"{web.base}/drives"


def test_a_token_that_another_signed_is_refused(web: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    from joserfc.jwk import KeySet, RSAKey  # noqa: PLC0415

    another = KeySet([RSAKey.generate_key(2048)])
    monkeypatch.setattr(KeySet, "import_key_set", lambda *_: another)
    with browser(web) as client:
        assert log_in(client, "anna").headers["location"] == f"{web.base}/login?failed=provider"


def test_a_provider_that_is_away_is_said(settings: Settings) -> None:
    chosen = {**CLIENT, "oidc_issuer": "http://127.0.0.1:9", "access": "keys"}
    with served(settings.model_copy(update=chosen)) as web:
        problem = check(web.client.get("/v1/session/oidc"), 401)
        assert problem["type"] == "/problems/login-failed"
        assert web.client.get("/healthz").status_code == 200


def test_without_a_provider_there_is_none(settings: Settings) -> None:
    with served(settings.model_copy(update={"access": "keys"})) as web:
        check(web.client.get("/v1/session/oidc"), 404)
        check(web.client.get("/v1/session/oidc/done?code=x&state=y"), 404)


def test_sessions_of_a_provider_keep_no_token(web: Web) -> None:
    with browser(web) as client:
        log_in(client, "anna")
        cookie = next(iter(client.cookies.values()))
        with web.sessions() as session:
            rows = str(session.execute(text("SELECT * FROM sessions")).all())
        assert cookie not in rows
        assert not re.search(r"eyJ", rows + cookie)


@pytest.fixture
def proxied(settings: Settings) -> Iterator[Web]:
    """A service behind a proxy that says who asks."""
    chosen = {"access": "keys", "trusted_proxies": "127.0.0.1", "proxy_secret": SecretStr(SHARED)}
    with served(settings.model_copy(update=chosen)) as running:
        yield running


SAID = {"X-Versant-Proxy-Secret": SHARED, "X-Forwarded-For": "192.0.2.7"}


def test_a_proxy_says_who_asks(proxied: Web) -> None:
    document = proxied.client.get("/v1/session", headers={**SAID, "Remote-User": "bus fleet"}).json()
    assert (document["scope"], document["owner"]["name"]) == ("own", "bus fleet")
    boss = {**SAID, "Remote-User": "office", "Remote-Role": "operate"}
    assert proxied.client.get("/v1/operations", headers=boss).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {**SAID, "X-Versant-Proxy-Secret": "guessed", "Remote-User": "bus fleet"},
        {"X-Forwarded-For": "192.0.2.7", "Remote-User": "bus fleet"},
        {**SAID, "Remote-User": ""},
        SAID,
        {**SAID, "Remote-User": "operator"},
        {**SAID, "Remote-User": "x" * 101},
    ],
)
def test_what_is_not_said_by_the_proxy_is_not_believed(proxied: Web, headers: dict[str, str]) -> None:
    check(proxied.client.get("/v1/drives", headers=headers), 401)


def test_a_client_that_is_no_proxy_is_not_believed_though_it_knows_the_secret(settings: Settings) -> None:
    chosen = {"access": "keys", "trusted_proxies": "192.0.2.1", "proxy_secret": SecretStr(SHARED)}
    with served(settings.model_copy(update=chosen)) as web:
        check(web.client.get("/v1/drives", headers={**SAID, "Remote-User": "bus fleet"}), 401)


def test_a_key_goes_before_what_the_proxy_says(proxied: Web) -> None:
    headers = {**SAID, "Remote-User": "bus fleet", "Authorization": "Bearer vsk_wrong"}
    check(proxied.client.get("/v1/drives", headers=headers), 401)


def test_a_change_through_a_proxy_says_where_it_comes_from(proxied: Web) -> None:
    said = {**SAID, "Remote-User": "bus fleet"}
    wanted = {"label": "x", "scope": "upload"}
    check(proxied.client.post("/v1/keys", json=wanted, headers=said), 403)
    foreign = {**said, "Origin": "http://elsewhere.example"}
    check(proxied.client.post("/v1/keys", json=wanted, headers=foreign), 403)
    own = {**said, "Origin": proxied.base}
    assert proxied.client.post("/v1/keys", json=wanted, headers=own).status_code == 201


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"OIDC_ISSUER": "https://login.example"}, "oidc_client_id"),
        ({"OIDC_ISSUER": "login.example"}, "http"),
        ({"PROXY_SECRET": "x"}, "trusted_proxies"),
        ({"TRUSTED_PROXIES": "127.0.0.1", "PROXY_SECRET": "x", "PROXY_OWNER_HEADER": "a b"}, "header"),
    ],
)
def test_half_a_setting_is_refused(
    monkeypatch: pytest.MonkeyPatch, given: dict[str, str], named: str
) -> None:
    for name, value in given.items():
        monkeypatch.setenv(f"VERSANT_{name}", value)
    with pytest.raises(SettingsError, match=named):
        load_settings()
