"""A service that asks for keys, two owners who know nothing of each other with what they have, and an operator."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from app.access import store
from app.core.caller import OPERATOR_OWNER, Scope
from app.core.db import Sessions
from app.core.settings import Settings
from web_fixtures import TLS, Web, add_drive, fill_roads, served

OWNERS = ("anna", "ben")


@dataclass(frozen=True)
class Holder:
    """A key in somebody's hands: a client that shows it."""

    owner_id: int
    key_id: uuid.UUID
    secret: str
    client: httpx.Client

    def get(self, path: str, **options: Any) -> httpx.Response:
        """Ask with the key."""
        return self.client.get(path, **options)

    def post(self, path: str, **options: Any) -> httpx.Response:
        """Ask with the key."""
        return self.client.post(path, **options)

    def delete(self, path: str, **options: Any) -> httpx.Response:
        """Ask with the key."""
        return self.client.delete(path, **options)


@dataclass(frozen=True)
class Party:
    """An owner with a key of scope ``own`` and one of scope ``upload``."""

    id: int
    own: Holder
    upload: Holder


@dataclass
class Keyed:
    """A service that asks for keys; ``web.client`` shows none."""

    web: Web
    stack: ExitStack
    secrets: dict[str, str] = field(default_factory=dict)
    """By caller: ``anna``, ``anna upload``, ``ben``, ``ben upload``, ``operate``, ``wrong``, ``revoked``."""
    ids: dict[str, uuid.UUID] = field(default_factory=dict)
    """Of their keys."""
    owners: dict[str, int] = field(default_factory=dict)
    a: Party = field(init=False)
    """Anna."""
    b: Party = field(init=False)
    """Ben."""
    operator: Holder = field(init=False)

    def ask(self, caller: str | None, method: str, path: str, **request: Any) -> httpx.Response:
        """The answer to that caller; None: to nobody."""
        headers = dict(request.pop("headers", {}))
        if caller is not None:
            headers["Authorization"] = f"Bearer {self.secrets[caller]}"
        return self.web.client.request(method, path, headers=headers, **request)

    def holder(self, owner_id: int, scope: Scope, label: str = "of a test") -> Holder:
        """A new key of that owner, and a client that shows it; the caller of that name."""
        with self.web.sessions.begin() as session:
            key, secret = store.create_key(session, owner_id, label, scope)
        self.ids[label], self.secrets[label] = key.id, secret
        headers = {"Authorization": f"Bearer {secret}"}
        options: dict[str, Any] = {"trust_env": False, "timeout": 60, "verify": TLS}
        client = self.stack.enter_context(httpx.Client(base_url=self.web.base, headers=headers, **options))
        return Holder(owner_id, key.id, secret, client)

    def party(self, name: str) -> Party:
        """A new owner."""
        with self.web.sessions.begin() as session:
            owner_id = self.owners[name] = store.create_owner(session, name).id
        own, upload = self.holder(owner_id, "own", name), self.holder(owner_id, "upload", f"{name} upload")
        return Party(owner_id, own, upload)

    def give(self, drive_id: uuid.UUID | str, to: Party) -> str:
        """Let a drive that a test made by itself belong to that owner; its id."""
        give_drive(self.web.sessions, drive_id, to.id)
        return str(drive_id)


@contextmanager
def asking_for_keys(settings: Settings, **changed: Any) -> Iterator[Keyed]:
    """A service with these settings but for what is ``changed``, two owners with keys, keys that let nobody in, and an
    operator."""
    with ExitStack() as stack:
        web = stack.enter_context(served(settings.model_copy(update={"access": "keys", **changed})))
        keyed = Keyed(web, stack, {"wrong": store.new_key()})
        keyed.a, keyed.b = (keyed.party(name) for name in OWNERS)
        keyed.operator = keyed.holder(OPERATOR_OWNER, "operate", "operate")
        revoked = keyed.holder(keyed.a.id, "own", "revoked")
        with web.sessions.begin() as session:
            store.revoke_key(session, revoked.key_id)
        yield keyed


@pytest.fixture
def keyed(settings: Settings) -> Iterator[Keyed]:
    """An empty service of this test alone that asks for keys."""
    with asking_for_keys(settings) as running:
        yield running


@pytest.fixture
def keyed_filled(grid_database: str, keyed: Keyed) -> Keyed:
    """The same with the grid's roads."""
    return keyed


@pytest.fixture
def guarded(settings: Settings) -> Iterator[Keyed]:
    """An empty one whose map is not public."""
    with asking_for_keys(settings, public_map="off") as running:
        yield running


@dataclass
class Things:
    """What one owner has, by the names of paths' parts."""

    ids: dict[str, str] = field(default_factory=dict)


def give_things(keyed: Keyed, owner: str) -> Things:
    """A drive over the grid with a trial, an export and a webhook."""
    drive = add_drive(keyed.web.sessions, [0, 1, 2])
    give_drive(keyed.web.sessions, drive, keyed.owners[owner], keyed.ids[f"{owner} upload"])
    things = Things({"drive_id": str(drive)})

    def made(path: str, document: dict[str, Any]) -> str:
        answer = keyed.ask(owner, "POST", path, json=document)
        assert answer.status_code in {201, 202}, answer.text
        return str(answer.json()["id"])

    things.ids["trial_id"] = made(f"/v1/drives/{drive}/trials", {"method": "raw"})
    things.ids["export_id"] = made("/v1/exports", {"format": "csv"})
    things.ids["webhook_id"] = made("/v1/webhooks", {"url": "http://127.0.0.1:9/x", "events": ["drive.done"]})
    things.ids["key_id"] = str(keyed.ids[f"{owner} upload"])
    return things


def give_drive(
    sessions: Sessions, drive: uuid.UUID | str, owner_id: int, key_id: uuid.UUID | None = None
) -> None:
    """Let the drive be that owner's, sent with that key."""
    with sessions.begin() as session:
        statement = text("UPDATE drives SET owner_id = :owner_id, sent_by = :key_id WHERE id = :id")
        session.execute(statement, {"owner_id": owner_id, "key_id": key_id, "id": drive})


@pytest.fixture
def shared(settings: Settings) -> Iterator[tuple[Keyed, dict[str, Things]]]:
    """A service with roads whose map is not public, and what each of two owners has."""
    with asking_for_keys(settings, public_map="off", webhook_private=True) as running:
        fill_roads(running.web.sessions)
        yield running, {owner: give_things(running, owner) for owner in OWNERS}
