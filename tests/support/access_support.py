"""A service that asks for keys, with two owners who know nothing of each other, and an operator."""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from app.access import store
from app.core.caller import OPERATOR_OWNER, Scope
from app.core.settings import Settings
from web_fixtures import TLS, Web, served


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


@dataclass(frozen=True)
class Keyed:
    """A service that asks for keys; ``web.client`` shows none."""

    web: Web
    a: Party
    b: Party
    operator: Holder
    stack: ExitStack

    def holder(self, owner_id: int, scope: Scope, label: str = "of a test") -> Holder:
        """A new key of that owner, and a client that shows it."""
        with self.web.sessions.begin() as session:
            key, secret = store.create_key(session, owner_id, label, scope)
        headers = {"Authorization": f"Bearer {secret}"}
        options: dict[str, Any] = {"trust_env": False, "timeout": 60, "verify": TLS}
        client = self.stack.enter_context(httpx.Client(base_url=self.web.base, headers=headers, **options))
        return Holder(owner_id, key.id, secret, client)

    def give(self, drive_id: uuid.UUID | str, to: Party) -> str:
        """Let a drive that a test made by itself belong to that owner; its id."""
        with self.web.sessions.begin() as session:
            change = text("UPDATE drives SET owner_id = :owner WHERE id = :id")
            session.execute(change, {"owner": to.id, "id": drive_id})
        return str(drive_id)


def keys_of(web: Web, stack: ExitStack) -> Keyed:
    """The owners A and B with their keys, and an operator's key, made in the service's database."""
    nobody: Any = None
    keyed = Keyed(web, nobody, nobody, nobody, stack)
    with web.sessions.begin() as session:
        owners = [store.create_owner(session, name).id for name in ("A", "B")]
    a, b = (Party(one, keyed.holder(one, "own"), keyed.holder(one, "upload")) for one in owners)
    return Keyed(web, a, b, keyed.holder(OPERATOR_OWNER, "operate"), stack)


@pytest.fixture
def keyed(settings: Settings) -> Iterator[Keyed]:
    """An empty service of this test alone that asks for keys."""
    with ExitStack() as stack:
        web = stack.enter_context(served(settings.model_copy(update={"access": "keys"})))
        yield keys_of(web, stack)


@pytest.fixture
def keyed_filled(grid_database: str, keyed: Keyed) -> Keyed:
    """The same with the grid's roads."""
    return keyed
