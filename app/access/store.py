"""Owners, keys, sessions and login links in the database. Callers own the transaction.

A secret is 256 random bits, told once and kept as its SHA-256 alone. So finding it by an index tells nobody anything by
the time that it takes: who asks would have to know hashes.
"""

from __future__ import annotations

import hashlib
import re
import secrets
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from typing import Any

from sqlalchemy import Row, text
from sqlalchemy.orm import Session

from app.core.caller import OPERATOR_OWNER, Caller, Scope, present_caller
from app.core.errors import ConflictError, UnauthorizedError
from app.core.messages import say

KEY_PREFIX = "vsk_"
"""By it those who look for secrets in published code find a key."""
SECRET_BYTES = 32
OWNER_NAME = re.compile(r"[^\x00-\x1f\x7f]{1,100}")
SESSION_TIME = timedelta(hours=12)
LINK_TIME = timedelta(hours=1)

_KEYS = """
    SELECT k.id, k.label, k.scope, k.owner_id, o.name AS owner, k.created_at, k.expires_at, k.last_used_on, k.revoked_at
    FROM keys AS k JOIN owners AS o ON o.id = k.owner_id
"""
_LIST = text(
    _KEYS
    + " WHERE CAST(:owner_id AS bigint) IS NULL OR k.owner_id = :owner_id ORDER BY o.name, k.created_at, k.id"
)
_KEY = text(_KEYS + " WHERE k.id = :id")
# Whoever is being removed has no key that lets anybody in, also where one was made just then.
_STAYS = "EXISTS (SELECT FROM owners AS o WHERE o.id = {} AND o.removed_at IS NULL)"
_IS_VALID = f"""
    k.revoked_at IS NULL AND (k.expires_at IS NULL OR k.expires_at > now()) AND {_STAYS.format("k.owner_id")}
"""
_BY_SECRET = f"""
    SELECT k.scope, k.owner_id, k.id, k.expires_at, k.last_used_on FROM keys AS k
    WHERE k.secret_sha256 = :secret AND {_IS_VALID}
"""  # noqa: S608 - constants
_BY_SESSION = f"""
    SELECT s.scope, s.owner_id, s.key_id AS id, least(s.expires_at, k.expires_at) AS expires_at, k.last_used_on
    FROM sessions AS s LEFT JOIN keys AS k ON k.id = s.key_id
    WHERE s.secret_sha256 = :secret AND s.expires_at > now() AND {_STAYS.format("s.owner_id")}
        AND (s.key_id IS NULL OR {_IS_VALID})
"""  # noqa: S608 - constants
_USED = text("UPDATE keys SET last_used_on = :day WHERE id = :id AND last_used_on IS DISTINCT FROM :day")
_CREATE_KEY = text("""
    INSERT INTO keys (id, owner_id, label, scope, secret_sha256, expires_at)
    VALUES (:id, :owner_id, :label, :scope, :secret, :expires_at)
""")
_REVOKE = text("UPDATE keys SET revoked_at = coalesce(revoked_at, now()) WHERE id = :id RETURNING id")
_ROTATE = text("UPDATE keys SET secret_sha256 = :secret WHERE id = :id AND revoked_at IS NULL RETURNING id")
_END_SESSIONS = text("DELETE FROM sessions WHERE key_id = :id")
_DROP_LINKS = text("DELETE FROM login_links WHERE key_id = :id")
_OWNERS = """
    SELECT o.id, o.name, o.created_at, o.removed_at, o.keep_logs_days,
           (SELECT count(*) FROM keys AS k WHERE k.owner_id = o.id AND k.revoked_at IS NULL) AS keys,
           of_drives.drives, of_drives.bytes
    FROM owners AS o, LATERAL (
        SELECT coalesce(sum(c.drives), 0)::bigint AS drives, coalesce(sum(c.size_bytes), 0)::bigint AS bytes
        FROM drive_counts AS c WHERE c.owner_id = o.id AND c.status <> 'cancelled') AS of_drives
"""
_CREATE_OWNER = text("INSERT INTO owners (name) VALUES (:name) ON CONFLICT (name) DO NOTHING RETURNING id")
_HOLD_OWNER = text("SELECT id FROM owners WHERE id = versant_owner() AND removed_at IS NULL FOR KEY SHARE")
_SET_KEEP_LOGS = text("UPDATE owners SET keep_logs_days = :days WHERE id = :owner_id")
_KEEP_SESSION = text("""
    INSERT INTO sessions (secret_sha256, owner_id, scope, key_id, expires_at)
    VALUES (:secret, :owner_id, :scope, :key_id, :expires_at)
""")
_KEEP_LINK = text(
    "INSERT INTO login_links (secret_sha256, key_id, expires_at) VALUES (:secret, :key_id, :expires_at)"
)
_BY_LINK = f"""
    WITH used AS (DELETE FROM login_links WHERE secret_sha256 = :secret RETURNING key_id, expires_at)
    SELECT k.scope, k.owner_id, k.id, k.expires_at, k.last_used_on FROM used JOIN keys AS k ON k.id = used.key_id
    WHERE used.expires_at > now() AND {_IS_VALID}
"""  # noqa: S608 - constants
_NAME_OF_OWNER = text("SELECT name FROM owners WHERE id = :id")
_END_SESSION = text("DELETE FROM sessions WHERE secret_sha256 = :secret")
_PRUNE = [text(f"DELETE FROM {table} WHERE expires_at < now()") for table in ("sessions", "login_links")]  # noqa: S608


@dataclass(frozen=True)
class Owner:
    """A person, a fleet or an office."""

    id: int
    name: str
    created_at: datetime
    removed_at: datetime | None
    """When its removal was asked for."""
    keep_logs_days: int | None
    """Days for which a log is kept after its drive has ended; None: as the settings say it."""
    keys: int
    """Those that are not revoked."""
    drives: int
    bytes: int
    """Of these drives."""


@dataclass(frozen=True)
class Key:
    """A key without its secret."""

    id: uuid.UUID
    label: str
    scope: Scope
    owner_id: int
    owner: str
    created_at: datetime
    expires_at: datetime | None
    last_used_on: date | None
    revoked_at: datetime | None


@dataclass(frozen=True)
class Known:
    """The caller that a secret stands for, and until when."""

    caller: Caller
    expires_at: datetime | None


def hashed(secret: str) -> bytes:
    """What is kept of a secret."""
    return hashlib.sha256(secret.encode("utf-8", "surrogatepass")).digest()


def owners(session: Session) -> list[Owner]:
    """All of them, by name."""
    return list(_owners(session, " ORDER BY o.name"))


def ensure_owner(session: Session, name: str) -> Owner:
    """The owner of that name, made where there is none."""
    session.execute(_CREATE_OWNER, {"name": name})
    found = owner_named(session, name)
    assert found is not None  # noqa: S101 - it is there now
    return found


def owner_named(session: Session, name: str) -> Owner | None:
    """The owner of that name, or None."""
    return next(_owners(session, " WHERE o.name = :of", of=name), None)


def get_owner(session: Session, owner_id: int) -> Owner | None:
    """The owner, or None."""
    return next(_owners(session, " WHERE o.id = :of", of=owner_id), None)


def create_owner(session: Session, name: str) -> Owner:
    """Make an owner; ``ConflictError`` where there is one of that name."""
    if session.execute(_CREATE_OWNER, {"name": name}).first() is None:
        raise ConflictError(say("access.owner_exists", name=name), field="name")
    made = owner_named(session, name)
    assert made is not None  # noqa: S101 - just made
    return made


def name_of_owner(session: Session, owner_id: int) -> str | None:
    """Its name, or None."""
    return session.execute(_NAME_OF_OWNER, {"id": owner_id}).scalar()


def hold_owner(session: Session) -> None:
    """Let the caller's owner not be removed before the transaction ends; ``UnauthorizedError`` where it is already.

    What is then made of the owner's is there when its removal begins, and goes with it.
    """
    if session.execute(_HOLD_OWNER).first() is None:
        raise UnauthorizedError(say("access.owner_removed"))


def own_id() -> int:
    """The number of the present caller's owner."""
    owner_id = present_caller().owner_id
    assert owner_id is not None  # noqa: S101 - whoever comes past a rule that needs a key has one
    return owner_id


def set_keep_logs(session: Session, owner_id: int, days: int | None) -> None:
    """Keep the owner's logs for so long after their drives have ended; None: as the settings say it."""
    session.execute(_SET_KEEP_LOGS, {"owner_id": owner_id, "days": days})


def caller_named(session: Session, name: str, *, operates: bool) -> Caller | None:
    """The caller whom a provider or a proxy names; its owner is made at the first time.

    None: it may not be. The operator's owner has what nobody else has: nobody gets into it by being called like it.
    """
    owner = ensure_owner(session, name)
    if owner.id == OPERATOR_OWNER and not operates:
        return None
    return Caller("operate" if operates else "own", owner.id)


def list_keys(session: Session, owner_id: int | None = None) -> list[Key]:
    """The keys of that owner, or of all."""
    return [Key(*row) for row in session.execute(_LIST, {"owner_id": owner_id})]


def get_key(session: Session, key_id: uuid.UUID) -> Key | None:
    """The key, or None."""
    row = session.execute(_KEY, {"id": key_id}).first()
    return None if row is None else Key(*row)


def create_key(
    session: Session, owner_id: int, label: str, scope: Scope, expires_at: datetime | None = None
) -> tuple[Key, str]:
    """Make a key; returns it and its secret, which nobody can be told again."""
    key_id, secret = uuid.uuid4(), new_key()
    values = {"owner_id": owner_id, "label": label, "scope": scope, "expires_at": expires_at}
    session.execute(_CREATE_KEY, {"id": key_id, "secret": hashed(secret), **values})
    return _existing(session, key_id), secret


def revoke_key(session: Session, key_id: uuid.UUID) -> bool:
    """Let nobody in by the key any more, nor by what stands for it; False: there is no such key."""
    _end(session, key_id)
    return session.execute(_REVOKE, {"id": key_id}).first() is not None


def rotate_key(session: Session, key_id: uuid.UUID) -> tuple[Key, str] | None:
    """Give the key another secret, the one before is void; None: there is no such key, or it is revoked."""
    secret = new_key()
    if session.execute(_ROTATE, {"id": key_id, "secret": hashed(secret)}).first() is None:
        return None
    _end(session, key_id)
    return _existing(session, key_id), secret


def create_link(session: Session, key_id: uuid.UUID, valid: timedelta = LINK_TIME) -> str:
    """The secret of a link that logs one browser in, as the key would."""
    secret = secrets.token_urlsafe(SECRET_BYTES)
    until = datetime.now(UTC) + valid
    session.execute(_KEEP_LINK, {"secret": hashed(secret), "key_id": key_id, "expires_at": until})
    return secret


def begin_session(session: Session, caller: Caller) -> str:
    """A new session of that caller: what its cookie holds."""
    for prune in _PRUNE:
        session.execute(prune)
    secret = secrets.token_urlsafe(SECRET_BYTES)
    values = {"owner_id": caller.owner_id, "scope": caller.scope, "key_id": caller.key_id}
    until = datetime.now(UTC) + SESSION_TIME
    session.execute(_KEEP_SESSION, {"secret": hashed(secret), "expires_at": until, **values})
    return secret


def end_session(session: Session, secret: str) -> None:
    """Log the browser out."""
    session.execute(_END_SESSION, {"secret": hashed(secret)})


def by_key(session: Session, secret: str) -> Known | None:
    """Whom the key stands for, or None; notes the day."""
    return _known(session, session.execute(text(_BY_SECRET), {"secret": hashed(secret)}).first())


def by_link(session: Session, secret: str) -> Known | None:
    """Whom the link stands for, once; None: there is no such link (any more)."""
    return _known(session, session.execute(text(_BY_LINK), {"secret": hashed(secret)}).first())


def by_session(session: Session, secret: str) -> Known | None:
    """Whom the session stands for, or None; notes the day."""
    return _known(session, session.execute(text(_BY_SESSION), {"secret": hashed(secret)}).first())


def by_proxy(session: Session, named: str) -> Known | None:
    """Whom a proxy names: the owner and, in a second line, the role."""
    name, _, role = named.partition("\n")
    if not OWNER_NAME.fullmatch(name):
        return None
    caller = caller_named(session, name, operates=role == "operate")
    return None if caller is None else Known(caller, None)


def new_key() -> str:
    """The secret of a new key."""
    return KEY_PREFIX + secrets.token_urlsafe(SECRET_BYTES)


def _owners(session: Session, which: str, **values: Any) -> Iterator[Owner]:
    return (Owner(*row) for row in session.execute(text(_OWNERS + which), values))


def _known(session: Session, row: Row[Any] | None) -> Known | None:
    if row is None:
        return None
    today = datetime.now(UTC).date()
    if row.id is not None and row.last_used_on != today:
        session.execute(_USED, {"id": row.id, "day": today})
    return Known(Caller(row.scope, row.owner_id, row.id), row.expires_at)


def _end(session: Session, key_id: uuid.UUID) -> None:
    for statement in (_END_SESSIONS, _DROP_LINKS):
        session.execute(statement, {"id": key_id})


def _existing(session: Session, key_id: uuid.UUID) -> Key:
    key = get_key(session, key_id)
    assert key is not None  # noqa: S101 - it was just made or changed
    return key
