"""The client against a service of a few lines: what it sends, and what it makes of each answer."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner

from app.cli import app
from app.cli.client import Client, ClientError
from processing_support import HEADER

SERVER = "http://service.example"


def client(answer: Callable[[httpx.Request], httpx.Response]) -> Client:
    return Client(SERVER, transport=httpx.MockTransport(answer))


def drive(status: str, **more: object) -> httpx.Response:
    document = {"id": "7", "status": status, "progress": 0.5, "stage": "filter", "failure": None} | more
    return httpx.Response(200, json=document)


def test_upload_sends_the_bytes_the_name_and_the_options(tmp_path: Path) -> None:
    path = tmp_path / "a drive.csv"
    path.write_bytes(b"x" * 200_000)
    seen: list[httpx.Request] = []
    counted: list[int] = []

    def answer(request: httpx.Request) -> httpx.Response:
        seen.append(request)
        request.read()
        return httpx.Response(202, json={"id": "7"}) if request.method == "POST" else drive("queued")

    with client(answer) as service:
        got = service.upload(path, method="raw", options={"min_epochs": 5}, sent=counted.append)
    assert (got.id, got.status, got.final) == ("7", "queued", False)
    assert b"x" * 200_000 in seen[0].content
    assert b'name="file"; filename="a drive.csv"' in seen[0].content
    assert seen[0].url.params["method"] == "raw"
    assert json.loads(seen[0].url.params["options"]) == {"min_epochs": 5}
    assert sum(counted) == 200_000


def test_several_files_are_sent_as_one_drive(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.obs", "a.nav")]
    for path in paths:
        path.write_bytes(path.name.encode() * 1000)
    seen: list[httpx.Request] = []
    counted: list[int] = []

    def answer(request: httpx.Request) -> httpx.Response:
        request.read()
        seen.append(request)
        return httpx.Response(202, json={"id": "7"}) if request.method == "POST" else drive("queued")

    with client(answer) as service:
        service.upload(*paths, gnss="receiver", sent=counted.append)
    for path in paths:
        assert f'name="file"; filename="{path.name}"'.encode() in seen[0].content
        assert path.read_bytes() in seen[0].content
    assert dict(seen[0].url.params) == {"gnss": "receiver"}
    assert sum(counted) == 10_000


def test_wait_follows_to_the_end_and_tells_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.cli.client.time.sleep", lambda seconds: None)
    failure = {"kind": "no-match", "reason": "No road is near."}
    answers = iter([drive("queued"), drive("running"), drive("failed", failure=failure)])
    seen: list[str] = []
    with client(lambda request: next(answers)) as service:
        final = service.wait("7", seen=lambda one: seen.append(one.status))
    assert seen == ["queued", "running", "failed"]
    assert final.reason == "No road is near."


def test_wait_gives_up_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.cli.client.time.sleep", lambda seconds: None)
    with client(lambda request: drive("queued")) as service, pytest.raises(ClientError, match="still queued"):
        service.wait("7", timeout_s=-1)


def test_all_pages_are_read() -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        page = int(request.url.params.get("page", 0))
        links = [{"rel": "self", "href": str(request.url)}]
        if page < 2:
            links.append({"rel": "next", "href": f"{SERVER}/collections/segments/items?page={page + 1}"})
        return httpx.Response(200, json={"features": [{"id": page}], "links": links})

    with client(answer) as service:
        assert [f["id"] for f in service.features("/collections/segments/items")] == [0, 1, 2]


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (httpx.Response(413, json={"detail": "The upload exceeds 5 bytes."}), "The upload exceeds 5 bytes."),
        (httpx.Response(502, text="<html>bad gateway"), "502"),
        (httpx.Response(500, json=["odd"]), "500"),
    ],
)
def test_refusals_become_sentences(answer: httpx.Response, said: str) -> None:
    with client(lambda request: answer) as service, pytest.raises(ClientError, match=said):
        service.drive("7")


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (httpx.ConnectError("refused"), "versant up"),
        (httpx.ReadTimeout("late"), "in time"),
        (httpx.ReadError("reset"), "broke"),
    ],
)
def test_a_service_that_is_not_there(error: httpx.TransportError, said: str) -> None:
    def answer(request: httpx.Request) -> httpx.Response:
        raise error

    with client(answer) as service, pytest.raises(ClientError, match=said):
        service.drive("7")


def test_upload_command_says_once_that_no_service_answers(tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["upload", "a.csv", "b.csv", "--server", "http://127.0.0.1:9"])
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert "127.0.0.1:9" in line
    assert "versant up" in line


WRONG_ADDRESSES = ["127.0.0.1:8000", "ftp://x", "http://", "http://x:port", "", "nonsense"]


@pytest.mark.parametrize("server", WRONG_ADDRESSES)
def test_upload_command_wants_an_address(server: str) -> None:
    result = CliRunner().invoke(app, ["upload", "a.csv", "--server", server], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert "--server" in result.stderr
    assert "http://host:port" in result.stderr
    assert "VERSANT_SERVER" not in result.stderr


def test_upload_command_names_a_missing_file_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(
        "app.cli.client.Client", lambda server, **key: client(lambda request: drive("queued"))
    )
    missing = tmp_path / "none.csv"
    result = CliRunner().invoke(app, ["upload", str(missing), "--server", SERVER])
    assert result.exit_code == 1
    assert result.stderr.count("none.csv") == 1
    assert "No such file" in result.stderr


Sent = list[tuple[list[str], dict[str, str]]]


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> Sent:
    """The names of the files and the query of each upload that the command sends."""
    uploads: Sent = []

    def answer(request: httpx.Request) -> httpx.Response:
        if request.method == "POST":
            names = re.findall(rb'filename="([^"]+)"', request.read())
            uploads.append(([name.decode() for name in names], dict(request.url.params)))
        return drive("queued")

    monkeypatch.setattr("app.cli.client.Client", lambda server, **key: client(answer))
    return uploads


def test_upload_command_makes_one_drive_of_a_folder_and_of_files_together(sent: Sent, tmp_path: Path) -> None:
    folder, lone = tmp_path / "monday", tmp_path / "lone.csv"
    (folder / "deeper").mkdir(parents=True)
    for path in (folder / "b.nav", folder / "a.obs", folder / ".hidden", folder / "deeper" / "c.csv", lone):
        path.write_bytes(b"x")
    (tmp_path / "empty").mkdir()
    figures = tmp_path / "figures.json"
    command = ["upload", str(folder), str(lone), "--server", SERVER]
    assert CliRunner().invoke(app, [*command, "--json", str(figures)]).exit_code == 0
    assert [one["file"] for one in json.loads(figures.read_text())["uploads"]] == [str(folder), str(lone)]
    choice = ["--together", "--gnss", "pf", "--gnss-option", "n=9", "--option", "m=1"]
    assert CliRunner().invoke(app, [*command, *choice]).exit_code == 0
    query = {"gnss": "pf", "grouping": "one", "options": json.dumps({"m": 1, "gnss_options": {"n": 9}})}
    assert sent == [
        (["a.obs", "b.nav"], {}),
        (["lone.csv"], {}),
        (["a.obs", "b.nav", "lone.csv"], query),
    ]
    none = CliRunner().invoke(app, ["upload", str(tmp_path / "empty"), "--server", SERVER])
    assert none.exit_code == 1
    assert none.stderr == f"versant: {tmp_path / 'empty'}: The folder holds no file.\n"


def test_a_folder_its_files_together_and_a_zip_of_them_are_one_drive_of_a_real_service(
    web: Any, tmp_path: Path
) -> None:
    folder = tmp_path / "monday"
    folder.mkdir()
    files = [folder / name for name in ("a.obs", "b.nav")]
    for path in files:
        path.write_bytes(HEADER + path.name.encode() * 1000)
    with zipfile.ZipFile(tmp_path / "all.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for path in files:
            archive.write(path, path.name)
    for names in ([folder], [*reversed(files), "--together"], [tmp_path / "all.zip"]):
        result = CliRunner().invoke(app, ["upload", *map(str, names), "--server", web.base])
        assert result.exit_code == 0, result.output
    (drive,) = web.client.get("/v1/drives").json()["drives"]
    assert (drive["filename"], drive["status"]) == ("a.obs, b.nav", "queued")
