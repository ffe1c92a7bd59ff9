"""``versant drives``: drives of a running service listed, shown, deleted, processed again; a client of its API."""

from __future__ import annotations

import typer

from app.cli.drives import look
from app.cli.drives.again import reprocess

drives = typer.Typer(
    no_args_is_help=True, help="List, show, delete or process again the drives of a service."
)
app = typer.Typer(add_completion=False)
app.add_typer(drives, name="drives")
drives.command("list")(look.list_drives)
drives.command("show")(look.show)
drives.command("delete")(look.delete)
drives.command("reprocess")(reprocess)
