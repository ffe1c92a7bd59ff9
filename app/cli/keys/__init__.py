"""``versant keys``: the keys of a service, made, listed, revoked, given another secret; on the database itself.

Whoever may open the database needs no key for it.
"""

from __future__ import annotations

import typer

from app.cli.keys import commands

keys = typer.Typer(
    no_args_is_help=True, help="Make, list, revoke or renew the keys of a service, or log a browser in."
)
app = typer.Typer(add_completion=False)
app.add_typer(keys, name="keys")
keys.command("create")(commands.create)
keys.command("list")(commands.list_keys)
keys.command("revoke")(commands.revoke)
keys.command("rotate")(commands.rotate)
keys.command("link")(commands.link)
