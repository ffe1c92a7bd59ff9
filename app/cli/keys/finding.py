"""Owners and keys that a command names, or does not name; where they are not to be found, what there is instead."""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import typer
from pydantic import TypeAdapter, ValidationError

from app.access import store
from app.access.documents import Name
from app.access.folder import read_key
from app.cli.console import spoken
from app.core.messages import say
from app.core.telemetry import audit
from fusion.errors import FusionError

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

ORIGIN = "versant keys"
"""What the audit log says of who it was: a person who may open the database."""
LIST = say("keys.list")


class KeysError(FusionError):
    """A command names an owner or a key that is not there, or that will not do."""

    kind = "keys"


def usable_name(text: str, option: str) -> str:
    """A name of an owner or a key as the service takes it; raises ``typer.BadParameter``."""
    try:
        return TypeAdapter(Name).validate_python(text)
    except ValidationError:
        raise typer.BadParameter(spoken(say("keys.name")), param_hint=f"'{option}'") from None


def note(session: Session, action: str, key: store.Key) -> None:
    """Write into the audit log what a command does to a key."""
    audit.note(session, ORIGIN, action, f"key {key.id}", scope=key.scope, owner=key.owner)


def the_owner(session: Session, name: str) -> store.Owner:
    """The owner of that name; ``KeysError`` names those that there are."""
    found = store.owner_named(session, name)
    if found is None:
        names = ", ".join(owner.name for owner in store.owners(session))
        raise KeysError(say("keys.no_owner", name=name, names=names))
    return found


def the_key(session: Session, key_id: uuid.UUID) -> store.Key:
    """The key of that id."""
    found = store.get_key(session, key_id)
    if found is None:
        raise KeysError(say("keys.no_key", id=key_id, advice=LIST))
    return found


def usable_key(session: Session, key_id: uuid.UUID) -> store.Key:
    """The key of that id, which lets somebody in."""
    key = the_key(session, key_id)
    if not _is_valid(key):
        what = "has expired" if key.revoked_at is None else "is revoked"
        raise KeysError(say("keys.void", id=key.id, what=what, advice=LIST))
    return key


def key_of_folder(session: Session, folder: Path) -> uuid.UUID | None:
    """The id of the key in ``operator.key`` of a data folder; None where there is none that counts."""
    secret = read_key(folder)
    known = None if secret is None else store.by_key(session, secret)
    return None if known is None else known.caller.key_id


def key_to_log_in(session: Session, key_id: uuid.UUID | None, folder: Path) -> store.Key:
    """The key that is named and may log a browser in; without a name the operator's.

    That is the key of the data folder, else the one key that operates the service.
    """
    key_id = key_id or key_of_folder(session, folder)
    if key_id is None:
        operating = [key for key in store.list_keys(session) if key.scope == "operate" and _is_valid(key)]
        if len(operating) != 1:
            several = "several keys operate" if operating else "no key operates"
            raise KeysError(say("keys.which", what=several, advice=LIST))
        key_id = operating[0].id
    key = usable_key(session, key_id)
    if key.scope in {"live", "upload"}:
        raise KeysError(say("keys.only_uploads", id=key.id, advice=LIST))
    return key


def _is_valid(key: store.Key) -> bool:
    return key.revoked_at is None and (key.expires_at is None or key.expires_at > datetime.now(UTC))
