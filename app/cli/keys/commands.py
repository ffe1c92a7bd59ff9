"""``versant keys``: the keys of a service, made, listed, revoked, given another secret; on the database itself.

Whoever may open the database needs no key for it. What a program is to take on, a secret or an address, stands alone
on standard output.
"""

from __future__ import annotations

import uuid
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import urlsplit

import typer

from app.cli.console import Console, write_json
from app.cli.database import sessions
from app.cli.options import DATA_DIR, JSON_FILE, arg, flag, opt
from app.core.messages import say

if TYPE_CHECKING:
    from app.access.store import Key

Scope = Literal["live", "upload", "own", "operate"]
"""The service's own names, known here without loading it."""

KEY_ID = arg("A key, as `list` names it.", metavar="ID")

keys = typer.Typer(
    no_args_is_help=True, help="Make, list, revoke or renew the keys of a service, or log a browser in."
)
app = typer.Typer(add_completion=False)
app.add_typer(keys, name="keys")


@keys.command("create")
def create(
    ctx: typer.Context,
    owner: str = opt("Whose key it is.", default=..., metavar="NAME"),
    scope: Scope = opt(
        "What it may: send points of drives under way (live), send drives (upload), all that concerns its "
        "owner's drives (own), everything (operate).",
        default="upload",
    ),
    label: str = opt(
        "What it is for, such as the device or program.", default="command line", metavar="TEXT"
    ),
    expires_days: int | None = opt(
        "Days after which it is void.  [default: never]", metavar="N", min=1, max=36_500
    ),
    new_owner: bool = flag("Make the owner, too.", "--new-owner"),
    data_dir: Path | None = DATA_DIR,
) -> None:
    """Make a key and print its secret, this once: the service keeps a hash of it alone."""
    from app.access import store
    from app.cli.keys.finding import note, the_owner, usable_name

    console: Console = ctx.obj
    owner, label = usable_name(owner, "--owner"), usable_name(label, "--label")
    expires_at = None if expires_days is None else datetime.now(UTC) + timedelta(days=expires_days)
    with sessions(data_dir) as (_, factory), factory.begin() as session:
        whose = store.create_owner(session, owner) if new_owner else the_owner(session, owner)
        key, secret = store.create_key(session, whose.id, label, scope, expires_at)
        note(session, "key made", key)
    console.note(say("keys.once", key=_described(key)))
    typer.echo(secret)


@keys.command("list")
def list_keys(
    ctx: typer.Context,
    owner: str | None = opt("Only keys of this owner.", metavar="NAME"),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """List keys by owner, with the day on which each was last used, those that are void as well."""
    from app.access import store
    from app.access.documents import Key as KeyDocument
    from app.cli.keys.finding import the_owner

    console: Console = ctx.obj
    with sessions(data_dir) as (_, factory), factory() as session:
        whose = None if owner is None else the_owner(session, owner).id
        keys = store.list_keys(session, whose)
    columns = ("id", "owner", "scope", "label", "created", "expires", "last used", "revoked")
    console.table(columns, [_row(key) for key in keys])
    write_json(json_file, {"keys": [KeyDocument.of(key).model_dump(mode="json") for key in keys]})


@keys.command("revoke")
def revoke(ctx: typer.Context, key_id: uuid.UUID = KEY_ID, data_dir: Path | None = DATA_DIR) -> None:
    """Let nobody in by a key any more, at once; it stays in the list."""
    from app.access import store
    from app.cli.keys.finding import note, the_key

    console: Console = ctx.obj
    with sessions(data_dir) as (_, factory), factory.begin() as session:
        key = the_key(session, key_id)
        store.revoke_key(session, key.id)
        note(session, "key revoked", key)
    console.note(say("keys.revoked", key=_described(key)))


@keys.command("rotate")
def rotate(ctx: typer.Context, key_id: uuid.UUID = KEY_ID, data_dir: Path | None = DATA_DIR) -> None:
    """Give a key another secret and print that, this once; the one before is void, and so are its sessions."""
    from app.access import store
    from app.access.folder import renew_key
    from app.cli.keys.finding import key_of_folder, note, usable_key

    console: Console = ctx.obj
    with sessions(data_dir) as (settings, factory), factory.begin() as session:
        key = usable_key(session, key_id)
        of_folder = key_of_folder(session, settings.data_dir) == key.id
        changed = store.rotate_key(session, key.id)
        assert changed is not None  # noqa: S101 - usable_key() has seen to it
        secret = changed[1]
        note(session, "key rotated", key)
        if of_folder:
            renew_key(settings.data_dir, secret)
    console.note(say("keys.rotated", key=_described(key)))
    typer.echo(secret)


@keys.command("link")
def link(
    ctx: typer.Context,
    key_id: uuid.UUID | None = arg(
        "A key, as `list` names it.  [default: the operator's]", default=None, metavar="[ID]"
    ),
    server: str | None = opt(
        "Address of the service.  [default: VERSANT_PUBLIC_URL, else VERSANT_SERVER]", metavar="URL"
    ),
    data_dir: Path | None = DATA_DIR,
) -> None:
    """Print an address that logs one browser in, once, within an hour; it may then do what the key may."""
    from app.access.store import create_link
    from app.cli.keys.finding import key_to_log_in
    from app.core.settings.access import is_loopback

    console: Console = ctx.obj
    with sessions(data_dir) as (settings, factory), factory.begin() as session:
        key = key_to_log_in(session, key_id, settings.data_dir)
        token = create_link(session, key.id)
    console.note(say("keys.link", key=_described(key)))
    service = server or settings.public_url or settings.server
    typer.echo(login_address(service, token))
    if is_loopback(urlsplit(service).hostname or ""):
        console.note(say("keys.link_here"))


def login_address(service: str, token: str, page: str | None = None) -> str:
    """Where a browser is logged in by a login link; ``page`` is where it goes then, else where the service likes.

    The token stands behind the #, so that no proxy and no log sees it.
    """
    from urllib.parse import urlencode

    query = "" if page is None else "?" + urlencode({"return_to": page})
    return f"{service.rstrip('/')}/login{query}#link={token}"


def _described(key: Key) -> str:
    """What a key is, in a sentence."""
    expires = "" if key.expires_at is None else say("keys.until", moment=_minute(key.expires_at))
    return say(
        "keys.described", id=key.id, label=key.label, owner=key.owner, scope=key.scope, expires=expires
    )


def _row(key: Key) -> list[Any]:
    times = _minute(key.created_at), _minute(key.expires_at), key.last_used_on, _minute(key.revoked_at)
    return [key.id, key.owner, key.scope, key.label, *times]


def _minute(moment: datetime | None) -> str | None:
    return None if moment is None else f"{moment.astimezone(UTC):%Y-%m-%d %H:%MZ}"
