"""A service that asks for keys, two owners with what they have, and the callers that there may be."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from app.access import store
from app.core.caller import OPERATOR_OWNER
from app.core.db import Sessions
from app.core.settings import Settings
from web_fixtures import Web, add_drive, fill_roads, served

OWNERS = ("anna", "ben")


@dataclass
class Guarded:
    """A service that asks for keys."""

    web: Web
    secrets: dict[str, str]
    """By caller: ``anna``, ``anna upload``, ``ben``, ``operate``, ``wrong``, ``revoked``."""
    ids: dict[str, uuid.UUID]
    owners: dict[str, int]

    def ask(self, caller: str | None, method: str, path: str, **request: Any) -> httpx.Response:
        """The answer to that caller; None: to nobody."""
        headers = dict(request.pop("headers", {}))
        if caller is not None:
            headers["Authorization"] = f"Bearer {self.secrets[caller]}"
        return self.web.client.request(method, path, headers=headers, **request)


def make_guarded(web: Web) -> Guarded:
    """Two owners with keys, keys that let nobody in, an operator."""
    guarded = Guarded(web, {"wrong": store.new_key()}, {}, {})
    with web.sessions.begin() as session:
        for name in OWNERS:
            owner = guarded.owners[name] = store.create_owner(session, name).id
            _add(guarded, session, name, owner, "own")
            _add(guarded, session, f"{name} upload", owner, "upload")
        _add(guarded, session, "operate", OPERATOR_OWNER, "operate")
        revoked = _add(guarded, session, "revoked", guarded.owners["anna"], "own")
        store.revoke_key(session, revoked)
    return guarded


def _add(guarded: Guarded, session: Any, caller: str, owner: int, scope: Any) -> uuid.UUID:
    key, guarded.secrets[caller] = store.create_key(session, owner, caller, scope)
    guarded.ids[caller] = key.id
    return key.id


@pytest.fixture
def guarded(settings: Settings) -> Iterator[Guarded]:
    """Without roads or drives; the map is not public."""
    with served(settings.model_copy(update={"access": "keys", "public_map": "off"})) as web:
        yield make_guarded(web)


@dataclass
class Things:
    """What one owner has, by the names of paths' parts."""

    ids: dict[str, str] = field(default_factory=dict)


def give_things(guarded: Guarded, owner: str) -> Things:
    """A drive over the grid with a trial, an export and a webhook."""
    drive = add_drive(guarded.web.sessions, [0, 1, 2])
    give_drive(guarded.web.sessions, drive, guarded.owners[owner], guarded.ids[f"{owner} upload"])
    things = Things({"drive_id": str(drive)})

    def made(path: str, document: dict[str, Any]) -> str:
        answer = guarded.ask(owner, "POST", path, json=document)
        assert answer.status_code in {201, 202}, answer.text
        return str(answer.json()["id"])

    things.ids["trial_id"] = made(f"/v1/drives/{drive}/trials", {"method": "raw"})
    things.ids["export_id"] = made("/v1/exports", {"format": "csv"})
    things.ids["webhook_id"] = made("/v1/webhooks", {"url": "http://127.0.0.1:9/x", "events": ["drive.done"]})
    things.ids["key_id"] = str(guarded.ids[f"{owner} upload"])
    return things


def give_drive(sessions: Sessions, drive: uuid.UUID, owner_id: int, key_id: uuid.UUID | None = None) -> None:
    """Let the drive be that owner's, sent with that key."""
    with sessions.begin() as session:
        statement = text("UPDATE drives SET owner_id = :owner_id, sent_by = :key_id WHERE id = :id")
        session.execute(statement, {"owner_id": owner_id, "key_id": key_id, "id": drive})


@pytest.fixture
def shared(settings: Settings) -> Iterator[tuple[Guarded, dict[str, Things]]]:
    """A service with roads, and what each of two owners has."""
    changed = {"access": "keys", "public_map": "off", "webhook_private": True}
    with served(settings.model_copy(update=changed)) as web:
        fill_roads(web.sessions)
        guarded = make_guarded(web)
        yield guarded, {owner: give_things(guarded, owner) for owner in OWNERS}
