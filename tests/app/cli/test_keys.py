"""``versant keys``: keys made, listed, revoked, given another secret, and links that log a browser in."""

from __future__ import annotations

import json
import re
import uuid
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from sqlalchemy import text
from typer.testing import CliRunner, Result

from app.access import store
from app.access.folder import FILE, LABEL, operator_key, read_key
from app.cli import app
from app.cli.keys.commands import login_address
from app.core.caller import OPERATOR_OWNER
from app.core.db import Sessions
from app.core.telemetry import audit

Run = Callable[..., Result]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path


@pytest.fixture
def run(database_url: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """``run(arguments)``: a command of ``versant keys`` on this test's database."""
    monkeypatch.setenv("VERSANT_DATABASE_URL", database_url)
    monkeypatch.setenv("VERSANT_DATA_DIR", str(folder))
    monkeypatch.setenv("VERSANT_ACCESS", "keys")

    def invoke(*arguments: object, status: int = 0) -> Result:
        result = CliRunner().invoke(app, ["keys", *map(str, arguments)], env={"COLUMNS": "200"})
        assert result.exit_code == status, result.output
        return result

    return invoke


def known(sessions: Sessions, secret: str) -> store.Known | None:
    with sessions.begin() as session:
        return store.by_key(session, secret)


def made(run: Run, *arguments: str) -> tuple[str, str]:
    """The id and the secret of a new key of the operator."""
    result = run("create", "--owner", "operator", *arguments)
    found = re.search(r"Key (\S+)", result.stderr)
    assert found is not None
    return found[1], result.stdout.strip()


def key_of_link(sessions: Sessions, printed: str) -> uuid.UUID | None:
    with sessions.begin() as session:
        found = store.by_link(session, printed.strip().rpartition("#link=")[2])
    return None if found is None else found.caller.key_id


def test_the_secret_stands_alone_on_standard_output(run: Run, sessions: Sessions) -> None:
    result = run("create", "--owner", "maria", "--new-owner", "--label", "her phone", "--expires-days", "30")
    assert re.fullmatch(r"vsk_[\w-]{43}\n", result.stdout)
    until = (datetime.now(UTC) + timedelta(days=30)).date()
    assert f"(her phone) of maria, scope upload, until {until} " in result.stderr
    assert result.stderr.endswith("Z. It is shown this once:\n")
    assert result.stdout.strip() not in result.stderr
    found = known(sessions, result.stdout.strip())
    assert found is not None and found.caller.scope == "upload"
    with sessions() as session:
        owner = store.owner_named(session, "maria")
    assert owner is not None and found.caller.owner_id == owner.id
    quiet = run("create", "--owner", "maria", "--scope", "own", "--quiet")
    assert quiet.stderr == "" and known(sessions, quiet.stdout.strip()) is not None


def test_an_owner_that_is_not_there_is_said_with_those_that_are(run: Run) -> None:
    run("create", "--owner", "maria", "--new-owner")
    result = run("create", "--owner", "anna", status=1)
    assert result.stdout == ""
    assert result.stderr.startswith("versant: There is no owner anna. There are: maria, operator.")
    again = run("create", "--owner", "maria", "--new-owner", status=1)
    assert "maria" in again.stderr and again.stdout == ""
    assert "There is no owner anna" in run("list", "--owner", "anna", status=1).stderr


@pytest.mark.parametrize(
    "arguments",
    [
        ["create"],
        ["create", "--owner", "operator", "--scope", "nobody"],
        ["create", "--owner", "operator", "--expires-days", "0"],
        ["create", "--owner", " ", "--new-owner"],
        ["create", "--owner", "operator", "--label", "two\nlines"],
        ["revoke", "7"],
        ["link", "none"],
    ],
    ids=str,
)
def test_what_cannot_be_is_wrong_usage(run: Run, arguments: list[str]) -> None:
    run(*arguments, status=2)


def test_keys_are_listed_without_secrets(run: Run, folder: Path) -> None:
    first, secret = made(run, "--scope", "operate", "--label", "prometheus")
    run("create", "--owner", "maria", "--new-owner")
    figures = folder / "keys.json"
    listed = run("list", "--json", figures)
    assert listed.stdout.splitlines()[0].split()[:4] == ["id", "owner", "scope", "label"]
    assert secret not in listed.output + figures.read_text()
    of_maria, of_operator = json.loads(figures.read_text())["keys"]
    assert (of_maria["owner"]["name"], of_maria["scope"], of_maria["revoked_at"]) == ("maria", "upload", None)
    assert (of_operator["id"], of_operator["label"]) == (first, "prometheus")
    assert first not in run("list", "--owner", "maria").stdout


def test_a_revoked_key_lets_nobody_in_and_stays_in_the_list(run: Run, sessions: Sessions) -> None:
    key_id, secret = made(run)
    for _ in range(2):
        assert "It is revoked." in run("revoke", key_id).stderr
    assert known(sessions, secret) is None
    assert key_id in run("list").stdout
    assert "is revoked" in run("rotate", key_id, status=1).stderr
    assert "is revoked" in run("link", key_id, status=1).stderr
    assert "There is no key" in run("revoke", uuid.uuid4(), status=1).stderr


def test_a_rotated_key_has_another_secret(run: Run, sessions: Sessions, folder: Path) -> None:
    key_id, secret = made(run, "--scope", "own")
    result = run("rotate", key_id)
    assert known(sessions, secret) is None
    found = known(sessions, result.stdout.strip())
    assert found is not None and (str(found.caller.key_id), found.caller.scope) == (key_id, "own")
    assert not (folder / FILE).exists()


def test_the_folder_follows_when_its_key_is_rotated(run: Run, sessions: Sessions, folder: Path) -> None:
    operator_key(folder, sessions)
    with sessions() as session:
        (key,) = [one for one in store.list_keys(session, OPERATOR_OWNER) if one.label == LABEL]
    secret = run("rotate", key.id).stdout.strip()
    assert read_key(folder) == secret
    assert operator_key(folder, sessions) == secret


def test_what_is_done_to_keys_is_in_the_audit_log(run: Run, sessions: Sessions) -> None:
    key_id, _ = made(run)
    run("rotate", key_id)
    run("revoke", key_id)
    with sessions() as session:
        rows = audit.entries(session, days=1)
    assert [(row["action"], row["subject"], row["origin"]) for row in rows] == [
        (action, f"key {key_id}", "versant keys") for action in ("key revoked", "key rotated", "key made")
    ]


def test_a_link_is_an_address_alone_and_logs_in_once(run: Run, sessions: Sessions) -> None:
    key_id, _ = made(run, "--scope", "own")
    printed = run("link", key_id).stdout
    assert re.fullmatch(r"http://127\.0\.0\.1:8000/login#link=[\w-]+\n", printed)
    assert str(key_of_link(sessions, printed)) == key_id
    assert key_of_link(sessions, printed) is None


def test_a_link_to_this_machine_says_how_to_lead_elsewhere(run: Run) -> None:
    made(run, "--scope", "operate")
    assert "name by --server the address" in run("link").stderr
    elsewhere = run("link", "--server", "https://versant.example")
    assert elsewhere.stdout.startswith("https://versant.example/login#link=")
    assert "--server" not in elsewhere.stderr


def test_a_link_is_valid_for_an_hour(run: Run, sessions: Sessions) -> None:
    made(run, "--scope", "operate")
    run("link")
    with sessions() as session:
        left = session.execute(text("SELECT expires_at - now() FROM login_links")).scalar_one()
    assert timedelta(minutes=58) < left <= timedelta(hours=1)


def test_without_a_name_the_link_is_of_the_key_of_the_folder(
    run: Run, sessions: Sessions, folder: Path
) -> None:
    made(run, "--scope", "operate")
    made(run, "--scope", "operate")
    assert "several keys operate this service" in run("link", status=1).stderr
    secret = operator_key(folder, sessions)
    found = known(sessions, secret)
    assert found is not None
    assert key_of_link(sessions, run("link").stdout) == found.caller.key_id


def test_without_a_folder_the_link_is_of_the_one_key_that_operates(run: Run, sessions: Sessions) -> None:
    assert "no key operates this service" in run("link", status=1).stderr
    made(run, "--scope", "own")
    revoked, _ = made(run, "--scope", "operate")
    run("revoke", revoked)
    key_id, _ = made(run, "--scope", "operate")
    assert str(key_of_link(sessions, run("link").stdout)) == key_id


def test_a_key_that_may_only_upload_logs_no_browser_in(run: Run) -> None:
    key_id, _ = made(run)
    assert "may only upload" in run("link", key_id, status=1).stderr


def test_an_expired_key_logs_nobody_in(run: Run, sessions: Sessions) -> None:
    past = datetime.now(UTC) - timedelta(seconds=1)
    with sessions.begin() as session:
        key, _ = store.create_key(session, OPERATOR_OWNER, "old", "operate", past)
    assert "has expired" in run("link", key.id, status=1).stderr


def test_a_link_leads_to_where_people_reach_the_service(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    made(run, "--scope", "operate")
    monkeypatch.setenv("VERSANT_SERVER", "http://127.0.0.1:9000")
    assert run("link").stdout.startswith("http://127.0.0.1:9000/login#link=")
    monkeypatch.setenv("VERSANT_PUBLIC_URL", "https://versant.example/")
    assert run("link").stdout.startswith("https://versant.example/login#link=")
    assert run("link", "--server", "http://here:1/").stdout.startswith("http://here:1/login#link=")


def test_the_page_after_the_login_is_named_before_the_secret() -> None:
    address = login_address("http://here", "token", "/map?bbox=1,2,3,4")
    assert address == "http://here/login?return_to=%2Fmap%3Fbbox%3D1%2C2%2C3%2C4#link=token"
