"""Who the client is: whoever the connection comes from, unless that is a proxy that was named."""

from __future__ import annotations

import logging
from collections.abc import Callable
from ipaddress import ip_network
from typing import Any

import pytest
from pydantic import ValidationError
from sqlalchemy import text

from app.core.receiving.clients import UNKNOWN, Shares, client_of, forwarded_for
from app.core.settings import Settings
from server_support import asking_from

FORGED = {"X-Forwarded-For": "203.0.113.9", "X-Forwarded-Proto": "https", "X-Forwarded-Host": "evil.example"}


def origin_of_removal(web: Any, client: Any, headers: dict[str, str]) -> str:
    """Remove a drive; the audit's origin of that."""
    log = b"time_s,lat_deg,lon_deg\n1700000000,49.0,8.4\n1700000001,49.0001,8.4\n"
    drive = client.post("/v1/drives", params={"filename": "a.csv"}, content=log).json()["id"]
    assert client.delete(f"/v1/drives/{drive}", headers=headers).status_code == 202
    with web.sessions() as session:
        return str(
            session.execute(text("SELECT origin FROM audit_log ORDER BY id DESC LIMIT 1")).scalar_one()
        )


def self_link(client: Any, headers: dict[str, str]) -> str:
    links = client.get("/v1/drives", headers=headers).json()["links"]
    return str(next(one["href"] for one in links if one["rel"] == "self"))


def test_nobody_is_believed_whom_no_setting_names(web: Any) -> None:
    """Not on loopback either, where uvicorn believes by itself."""
    assert origin_of_removal(web, web.client, FORGED).startswith("127.0.0.1 ")
    assert self_link(web.client, FORGED).startswith(web.base)


def test_a_proxy_that_is_named_is_believed(
    settings: Settings, server_maker: Callable[[Settings], Any]
) -> None:
    named = settings.model_copy(update={"trusted_proxies": "127.0.0.2, 10.0.0.0/8"})
    told = {**FORGED, "X-Forwarded-For": "198.51.100.7, 203.0.113.9, 10.1.2.3"}
    with server_maker(named) as web, asking_from(web, "127.0.0.2") as proxy:
        assert origin_of_removal(web, proxy, told).startswith("203.0.113.9 ")
        assert self_link(proxy, told).startswith(web.base.replace("http:", "https:"))
        assert "evil.example" not in self_link(proxy, told)
        same_page = {"Origin": web.base.replace("http:", "https:"), **told}
        nothing = "00000000-0000-0000-0000-000000000000"
        assert proxy.delete(f"/v1/drives/{nothing}", headers=same_page).status_code == 404
        assert origin_of_removal(web, web.client, told).startswith("127.0.0.1 "), "another one is not"


def test_a_proxy_that_nobody_named_is_told_of_once(web: Any, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING, logger="app.core.receiving.clients"):
        for _ in range(3):
            web.client.get("/v1/drives", headers=FORGED)
    told = [
        record.getMessage() for record in caplog.records if "VERSANT_TRUSTED_PROXIES" in record.getMessage()
    ]
    assert len(told) == 1
    assert "203.0.113.9" not in told[0]


@pytest.mark.parametrize(
    ("told", "client"),
    [
        ("203.0.113.9", "203.0.113.9"),
        ("1.2.3.4, 203.0.113.9", "203.0.113.9"),
        ("1.2.3.4,203.0.113.9 , 10.1.2.3", "203.0.113.9"),
        ("203.0.113.9:4711", "203.0.113.9"),
        ("[2001:db8::1]:4711", "2001:db8::1"),
        ("2001:db8::1", "2001:db8::1"),
        ("::ffff:203.0.113.9", "203.0.113.9"),
        ("10.4.4.4, 10.1.2.3", "10.4.4.4"),
        ("203.0.113.9, unknown", "10.0.0.1"),
        ("203.0.113.9, what, 10.1.2.3", "10.1.2.3"),
        ("", "10.0.0.1"),
        ("," * 5000, "10.0.0.1"),
    ],
)
def test_the_client_is_the_last_that_is_no_proxy_of_ours(told: str, client: str) -> None:
    assert forwarded_for("10.0.0.1", told, [ip_network("10.0.0.0/8")]) == client


@pytest.mark.parametrize(
    ("address", "client"),
    [
        ("203.0.113.9", "203.0.113.9"),
        ("::ffff:203.0.113.9", "203.0.113.9"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::", "2001:db8:1:2::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("", UNKNOWN),
        ("/run/versant.sock", UNKNOWN),
    ],
)
def test_what_limits_count_an_address_as(address: str, client: str) -> None:
    assert client_of(address) == client


@pytest.mark.parametrize("proxies", ["proxy.example", "10.0.0.1/8", "10.0.0.0/33", "*"])
def test_what_is_no_network_is_refused_at_the_start(proxies: str) -> None:
    with pytest.raises(ValidationError, match="each must be an IP address"):
        Settings(trusted_proxies=proxies)


def test_few_clients_cannot_take_all() -> None:
    shares = Shares(most=8, per_client=100)
    for client in "abc":
        while shares.allows(client):
            shares.take(client)
    assert shares.held == {"a": 4, "b": 2, "c": 1}
    assert shares.allows("d")
    shares.give_back("a")
    assert shares.total == 6
    assert not Shares(8, 0).allows("a")
