"""The key that client commands show: where it comes from, to whom it goes, and what is said where it does not do."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest
from typer.testing import CliRunner, Result

from app.access.folder import FILE
from app.cli import app
from app.cli.client import Client, ClientError, RefusedKeyError
from processing_support import HEADER

HERE, ELSEWHERE = "http://127.0.0.1:8000", "https://versant.example"
OF_FOLDER, OF_ENVIRONMENT, OF_OPTION = ("vsk_" + letter * 43 for letter in "fEo")

Answer = Callable[[httpx.Request], httpx.Response]


def client(answer: Answer, server: str = HERE, key: str | None = OF_OPTION) -> Client:
    return Client(server, key=key, transport=httpx.MockTransport(answer))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder with a key in it, which the environment names."""
    (tmp_path / FILE).write_text(OF_FOLDER + "\n")
    monkeypatch.setenv("VERSANT_DATA_DIR", str(tmp_path))
    return tmp_path


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> Callable[..., str | None]:
    """``shown(arguments)``: the key that ``drives list`` shows a service."""

    def run(*arguments: str, status: int = 0) -> str | None:
        seen: list[str | None] = []

        def answer(request: httpx.Request) -> httpx.Response:
            seen.append(request.headers.get("Authorization"))
            return httpx.Response(200, json={"drives": [], "links": []})

        made = lambda server, key: client(answer, server, key)  # noqa: E731
        monkeypatch.setattr("app.cli.client.Client", made)
        result = CliRunner().invoke(app, ["drives", "list", *arguments])
        assert result.exit_code == 0, result.output
        (header,) = seen
        return header and header.removeprefix("Bearer ")

    return run


@pytest.mark.parametrize("server", [HERE, "http://localhost:9", "http://[::1]:8000"])
def test_a_service_on_this_machine_is_shown_the_key_of_the_folder(
    folder: Path, shown: Callable[..., str | None], server: str
) -> None:
    assert shown("--server", server) == OF_FOLDER


@pytest.mark.parametrize(
    "server", [ELSEWHERE, "http://10.0.0.5:8000", "http://127.0.0.1.example", "http://localhost.example"]
)
def test_no_other_machine_is_shown_the_key_of_the_folder(
    folder: Path, shown: Callable[..., str | None], server: str
) -> None:
    assert shown("--server", server) is None


def test_a_key_that_is_named_goes_before_that_of_the_folder_and_anywhere(
    folder: Path, shown: Callable[..., str | None], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert shown("--server", ELSEWHERE, "--key", OF_OPTION) == OF_OPTION
    monkeypatch.setenv("VERSANT_KEY", OF_ENVIRONMENT)
    assert shown("--server", HERE) == OF_ENVIRONMENT
    assert shown("--server", ELSEWHERE) == OF_ENVIRONMENT
    assert shown("--server", HERE, "--key", OF_OPTION) == OF_OPTION


def test_the_folder_may_be_named(folder: Path, shown: Callable[..., str | None], tmp_path: Path) -> None:
    other = tmp_path / "other"
    other.mkdir()
    assert shown("--data-dir", str(other)) is None
    (other / FILE).write_text(OF_OPTION)
    assert shown("--data-dir", str(other)) == OF_OPTION


@pytest.mark.parametrize("content", [b"", b"secret of another program", b"vsk_cut", b"\xff\xfe"])
def test_what_is_no_key_is_not_sent(folder: Path, shown: Callable[..., str | None], content: bytes) -> None:
    (folder / FILE).write_bytes(content)
    assert shown() is None


@pytest.mark.skipif(os.geteuid() == 0, reason="root reads everything")
def test_a_key_that_this_user_may_not_read_is_none(folder: Path, shown: Callable[..., str | None]) -> None:
    (folder / FILE).chmod(0)
    assert shown() is None


@pytest.mark.parametrize("environment", [False, True])
def test_a_text_that_cannot_be_a_key_is_wrong_usage_and_not_repeated(
    environment: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = "vsk_schlüssel"
    if environment:
        monkeypatch.setenv("VERSANT_KEY", wrong)
    result = CliRunner().invoke(
        app, ["drives", "list"] if environment else ["drives", "list", "--key", wrong], env={"COLUMNS": "200"}
    )
    assert result.exit_code == 2
    assert "'--key' or VERSANT_KEY" in result.stderr
    assert "schl" not in result.stderr


def test_a_link_to_another_host_is_not_followed_there() -> None:
    """The service answers with the host under which others reach it."""
    asked: list[httpx.URL] = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request.url)
        assert request.headers["Authorization"] == f"Bearer {OF_OPTION}"
        link = {"rel": "next", "href": f"{ELSEWHERE}/prefix/v1/drives?after=2&limit=1"}
        return httpx.Response(200, json={"links": [] if "after" in request.url.params else [link]})

    with client(answer) as service:
        assert len(list(service.pages("/v1/drives", {"limit": 1}))) == 2
    assert [str(url) for url in asked] == [f"{HERE}/v1/drives?limit=1", f"{HERE}/v1/drives?after=2&limit=1"]


@pytest.mark.parametrize(
    "address",
    [f"{ELSEWHERE}/v1/drives", "http://127.0.0.1:8001/v1/drives", "https://127.0.0.1:8000/v1/drives"],
)
def test_an_address_of_another_server_is_asked_without_the_key(address: str) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        assert "Authorization" not in request.headers
        return httpx.Response(200)

    with client(answer) as service:
        service.get(address)


@pytest.mark.parametrize("location", [f"{ELSEWHERE}/v1/drives", "https://127.0.0.1:8000/v1/drives"])
def test_a_redirect_is_said_and_not_followed(location: str) -> None:
    asked: list[str] = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request.url.host)
        return httpx.Response(308, headers={"Location": location})

    with client(answer) as service, pytest.raises(ClientError, match=f"sends on to {location}.*--server"):
        service.get("/v1/drives")
    assert asked == ["127.0.0.1"]


def problem(status: int, kind: str, detail: str = "No.") -> httpx.Response:
    return httpx.Response(status, json={"type": f"{HERE}/problems/{kind}", "detail": detail})


def test_it_is_said_what_to_do_about_keys() -> None:
    refuse = lambda request: problem(401, "unauthorized")  # noqa: E731
    with (
        client(refuse, key=None) as service,
        pytest.raises(ClientError, match=r"asks for a key\. Name one by"),
    ):
        service.drive("7")
    with client(refuse) as service, pytest.raises(ClientError, match="does not take the key") as caught:
        service.drive("7")
    assert OF_OPTION not in str(caught.value)
    small = lambda request: problem(403, "forbidden", "This takes a key of scope own.")  # noqa: E731
    with client(small) as service, pytest.raises(RefusedKeyError, match=r"scope own\. --key or VERSANT_KEY"):
        service.drive("7")


def test_a_login_of_something_in_front_is_not_taken_for_ours() -> None:
    with (
        client(lambda request: httpx.Response(401, text="<html>Log in")) as service,
        pytest.raises(ClientError, match="answered 401"),
    ):
        service.drive("7")


def run_upload(answer: Answer, monkeypatch: pytest.MonkeyPatch, log: Path) -> Result:
    monkeypatch.setattr("app.cli.client.Client", lambda server, key: client(answer, server, OF_OPTION))
    log.write_bytes(HEADER)
    return CliRunner().invoke(app, ["upload", "--wait", str(log), str(log)])


def test_a_key_that_may_only_upload_waits_for_the_end_of_its_drive(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        if request.url.path.endswith("/segments"):
            return problem(403, "forbidden")
        request.read()
        return httpx.Response(200, json={"id": "7", "status": "done", "links": []})

    result = run_upload(answer, monkeypatch, tmp_path / "monday.csv")
    assert result.exit_code == 0, result.output
    assert "done" in result.stdout


def test_a_refused_key_is_said_once_with_status_1(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        return httpx.Response(200) if request.url.path == "/healthz" else problem(401, "unauthorized")

    result = run_upload(answer, monkeypatch, tmp_path / "monday.csv")
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert "does not take the key" in line
