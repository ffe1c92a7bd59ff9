"""Where a command finds the service."""

from __future__ import annotations

from typing import Annotated

import typer

from app.cli.client import Client, ClientError
from app.core.settings import load_settings

Server = Annotated[
    str | None, typer.Option(metavar="URL", help="Address of the service.  [default: VERSANT_SERVER]")
]


def service_client(server: str | None) -> Client:
    """A client of the service that ``--server`` or the settings name; raises ``typer.BadParameter``."""
    if server is None:
        return Client(load_settings().server)
    try:
        return Client(server)
    except ClientError as error:
        raise typer.BadParameter(str(error), param_hint="'--server'") from error
