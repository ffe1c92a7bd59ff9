"""One message on its way: signed, to an address that may be called, within its time."""

from __future__ import annotations

import socket
import time
from typing import Any

import pytest

from app.changes.webhooks import sending
from app.changes.webhooks.sending import Answer, RefusedError, check_url, new_secret, post, signature
from receiver import receiving


def test_messages_are_signed_as_the_standard_has_it() -> None:
    """The example of the specification's own libraries."""
    signed = signature(
        "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw",
        "msg_p5jXN8AQM9LWM0D4loKWxJek",
        1614265330,
        b'{"test": 2432232314}',
    )
    assert signed == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def test_secrets_are_long_and_none_is_like_another() -> None:
    assert len({new_secret() for _ in range(10)}) == 10
    assert len(new_secret()) == len("whsec_") + 44


@pytest.mark.parametrize(
    "url",
    [
        "https://example.org/told",
        "https://example.org:8443/told?x=1",
        "https://93.184.216.34/",
        "https://[2606:4700::1111]/",
        "https://[64:ff9b::5db8:d822]/",  # how a network of version 6 alone reaches 93.184.216.34
    ],
)
def test_public_addresses_may_be_called(url: str) -> None:
    check_url(url, private=False)


PRIVATE = [
    "http://127.0.0.1/",
    "https://127.0.0.1/",
    "https://10.1.2.3/",
    "https://192.168.1.1/",
    "https://172.16.0.1/",
    "https://169.254.169.254/latest/meta-data",
    "https://100.64.0.1/",
    "https://0.0.0.0/",
    "https://224.0.1.1/",
    "https://[::1]/",
    "https://[::]/",
    "https://[fe80::1]/",
    "https://[fc00::1]/",
    "https://[::ffff:127.0.0.1]/",
    "https://[64:ff9b::7f00:1]/",
    "https://[64:ff9b::a9fe:a9fe]/",
    "https://[2002:7f00:1::]/",
    "https://[ff02::1]/",
    "https://[::127.0.0.1]/",
    "https://[::93.184.216.34]/",
    "https://[fec0::1]/",
    "https://[feff:ffff::1]/",
    "https://[::ffff:0:127.0.0.1]/",
    "https://[::ffff:10.0.0.1]/",
    "https://[::ffff:93.184.216.34]/",
    "https://[64:ff9b:1::7f00:1]/",
    "https://[64:ff9b:1::5db8:d822]/",
    "https://[64:ff9b::e000:101]/",
    "https://[2002:a00:1::]/",
    "https://[2002:5db8:d822::1]/",
    "https://[2001::1]/",
    "https://[2001:0:7f00:1::]/",
    "https://[2001:db8::1]/",
    "https://[3fff::1]/",
    "https://[5f00::1]/",
    "https://[100::1]/",
    "https://[ff0e::1]/",
    "https://192.0.0.8/",
    "https://192.0.2.1/",
    "https://192.88.99.1/",
    "https://198.18.0.1/",
    "https://198.51.100.1/",
    "https://203.0.113.1/",
    "https://240.0.0.1/",
    "https://255.255.255.255/",
    "http://example.org/",
]


@pytest.mark.parametrize("url", PRIVATE)
def test_addresses_of_this_machine_and_of_private_networks_may_not_unless_it_is_said(url: str) -> None:
    with pytest.raises(RefusedError, match="VERSANT_WEBHOOK_PRIVATE"):
        check_url(url, private=False)
    check_url(url, private=True)


@pytest.mark.parametrize(
    "url",
    [
        "", "x", "ftp://example.org/", "https://", "https:///x", "https://example.org:99999/", "https://example.org:0/",
        "https://user:word@example.org/", "https://example.org/#part", "https://example.org/a b", "https://e x.org/",
        "https://example.org/\r\nHost: x", "https://[::1/", "https://example.org/ä", "https://" + "x" * 2000 + ".org/",
        "file:///etc/passwd", "https://.../",
    ],
)  # fmt: skip
def test_what_is_no_address_is_none(url: str) -> None:
    for private in (False, True):
        with pytest.raises(RefusedError, match=r"it "):
            check_url(url, private=private)


def send(url: str, *, timeout_s: float = 5.0, private: bool = True) -> Answer:
    return post(url, {"webhook-id": "msg_1"}, b"{}", timeout_s=timeout_s, private=private)


def test_a_message_arrives_whole_and_is_taken_by_any_status_of_success() -> None:
    with receiving(200, 202, 204) as receiver:
        for status in (200, 202, 204):
            assert send(receiver.url) == Answer(status, None)
        headers, body = receiver.got[0]
        assert body == b"{}"
        assert headers["webhook-id"] == "msg_1"
        assert headers["host"] == receiver.url.split("/")[2]


def test_a_redirect_is_not_followed_and_what_is_gone_is_unwanted() -> None:
    with receiving(302, 410, 500) as receiver:
        redirected = send(receiver.url)
        assert redirected.status == 302
        assert "redirects are not followed" in str(redirected.problem)
        assert send(receiver.url) == Answer(410, "It answered 410.", unwanted=True)
        assert send(receiver.url) == Answer(500, "It answered 500.")
        assert len(receiver.got) == 3


@pytest.mark.parametrize("answer", ["hang", "drip"])
def test_who_does_not_answer_in_time_is_left(answer: str) -> None:
    with receiving(answer) as receiver:
        begun_s = time.monotonic()
        assert send(receiver.url, timeout_s=0.3).problem == "There was no answer within 0.3 s."
        assert time.monotonic() - begun_s < 5


def test_a_name_that_leads_home_is_not_called_whatever_it_was_before(monkeypatch: pytest.MonkeyPatch) -> None:
    """What counts is the address that is connected to, not an earlier look."""
    with receiving() as receiver:
        port = int(receiver.url.split(":")[2].split("/")[0])

        def found(host: str, *_: object, **__: object) -> list[Any]:
            assert host == "rebound.example"
            return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", port))]

        monkeypatch.setattr(sending.socket, "getaddrinfo", found)
        refused = send("https://rebound.example/", private=False)
        assert "VERSANT_WEBHOOK_PRIVATE" in str(refused.problem)
        assert receiver.got == []


def test_what_cannot_be_reached_is_said_in_words_without_the_address(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        nobody = f"http://127.0.0.1:{closed.getsockname()[1]}/token"
        assert send(nobody).problem == "The address could not be reached: connection refused."
    with receiving() as receiver:
        secure = receiver.url.replace("http", "https")
        assert "could not be reached" in str(send(secure).problem)
        assert "token" not in str(send(secure).problem)

    def unknown(*_: object, **__: object) -> list[Any]:
        raise socket.gaierror(-2, "Name or service not known")

    monkeypatch.setattr(sending.socket, "getaddrinfo", unknown)
    assert (
        send("https://nowhere.example/").problem == "The address could not be reached: its name is not known."
    )
