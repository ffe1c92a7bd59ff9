"""Who a request is from, and what the database shows it: one answer for routes, uploads, the audit and SQL.

The gate (``app.access.gate``) says it once for each request. Every transaction of the API then begins with the caller's
role and owner, and row level security (migration 0031) shows that role the rows that are its own. So a query that
forgets to ask whose a drive is finds no drive of somebody else. Workers and commands are nobody's requests: they
connect as the owner of the tables, whom the policies do not bind.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from typing import Any, Literal

from sqlalchemy import Connection, Engine, text
from sqlalchemy.orm import Session

from app.core.db import Sessions, begin_with, session_factory

Scope = Literal["nobody", "live", "upload", "own", "operate"]

SCOPES: tuple[Scope, ...] = ("nobody", "live", "upload", "own", "operate")
"""Each may do what those before it may."""
OPERATOR_OWNER = 1
"""The owner of what nobody else owns: of everything from before there were owners."""

API_ROLE = "versant_api"
"""Of whoever is nobody: it sees no row that has an owner. The others are members of it."""
ROLES: dict[Scope, str] = {
    "nobody": API_ROLE,
    "live": "versant_uploader",
    "upload": "versant_uploader",  # sees what its key sent
    "own": "versant_owner",  # sees what is its owner's
    "operate": "versant_operator",  # sees everything
}

PUBLIC_ROLE = "versant_public"
"""Of whoever is nobody where the public reads editions: it may read these, the roads, and nothing else."""
EDITION, TOLD = "edition", "told"
"""Schemas: what the public reads, and what that was made of."""
EDITION_PATH = f"{EDITION}, public"
Sees = Literal["live", "edition"]

STILL_KNOWN = "versant.still_known"
"""What the scope of a request has where its caller showed a key: a stream asks by it before it tells anything more."""

_BECOME = """
    SELECT set_config('role', %s, true), set_config('versant.owner', %s, true), set_config('versant.key', %s, true)
"""
_READ_EDITION = f"SELECT set_config('search_path', '{EDITION_PATH}', true)"
_TAKE = text("SELECT current_setting('role'), set_config('role', :role, true)")


@dataclass(frozen=True)
class Caller:
    """Whoever a request is from."""

    scope: Scope = "nobody"
    owner_id: int | None = None
    key_id: uuid.UUID | None = None
    sees: Sees = "live"
    """Of the map: as it is now, or the last edition."""

    @property
    def role(self) -> str:
        """The role of the database."""
        return PUBLIC_ROLE if self.scope == "nobody" and self.sees == "edition" else ROLES[self.scope]

    def may(self, scope: Scope) -> bool:
        """Whether the caller may do what needs ``scope``."""
        return SCOPES.index(self.scope) >= SCOPES.index(scope)

    @property
    def confined_to(self) -> int | None:
        """The owner of whose rows alone the caller sees any; None: it sees those of all, or none of anybody."""
        return self.owner_id if self.scope in {"live", "upload", "own"} else None

    @property
    def as_owner(self) -> Caller:
        """The caller as it sees what its owner has: an upload looks there for the same log."""
        return replace(self, scope="own") if self.scope in {"live", "upload"} else self


NOBODY = Caller()
SERVICE = Caller("operate", OPERATOR_OWNER)
"""The service itself, and everybody where no keys are asked for."""

_present: ContextVar[Caller] = ContextVar("caller of this request", default=NOBODY)


def present_caller() -> Caller:
    """Whoever the request that is being answered is from."""
    return _present.get()


@contextmanager
def as_caller(caller: Caller) -> Iterator[None]:
    """Do what is in the block as that caller."""
    token = _present.set(caller)
    try:
        yield
    finally:
        _present.reset(token)


def read_edition(session: Session) -> None:
    """In what is left of the session's transaction read the map of the last edition."""
    session.execute(text(_READ_EDITION))


@contextmanager
def seeing_all(session: Session) -> Iterator[None]:
    """In the session's transaction, see what every owner has: a limit of the service is one of all of them together.

    Whose rows they are is not to be told. Where the block raises, the transaction is rolled back.
    """
    if present_caller().may("operate"):
        yield
        return
    role = session.execute(_TAKE, {"role": ROLES["operate"]}).scalar_one()
    try:
        yield
    except BaseException:
        session.rollback()
        raise
    session.execute(_TAKE, {"role": role})


def has_share(mine: int, held: int, most: int) -> bool:
    """Whether the caller, who has ``mine`` of the ``held``, may have one more of what the service has ``most`` of.

    An owner has no more than are left, as clients do (``app.core.receiving.clients.Shares``): one alone half of all,
    two a third each. Operators may have all.
    """
    return present_caller().scope not in {"upload", "own"} or mine < most - held


def guarded(sessions: Sessions) -> Sessions:
    """Sessions on the same connections whose transactions are the present caller's: for a worker that acts for one."""
    engine: Engine = sessions.kw["bind"]
    return session_factory(guard(engine.execution_options()))


def guard(engine: Engine) -> Engine:
    """Let every transaction of ``engine`` begin with the role and the owner of the present caller."""

    def become(connection: Connection) -> None:
        caller = present_caller()
        driver: Any = connection.connection.driver_connection
        owner = "" if caller.owner_id is None else str(caller.owner_id)
        driver.execute(_BECOME, (caller.role, owner, str(caller.key_id or "")))
        if caller.sees == "edition":
            driver.execute(_READ_EDITION)

    begin_with(engine, become)
    return engine
