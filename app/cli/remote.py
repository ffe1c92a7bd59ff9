"""``versant upload``: a client of a running service, which it knows by its API alone; ``versant drives`` is another."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.console import Bars, Console, write_json
from app.cli.options import JsonFile, parse_assignments
from fusion.errors import FusionError

if TYPE_CHECKING:
    from app.cli.client import Client, RemoteDrive

app = typer.Typer(add_completion=False)

Server = Annotated[
    str | None, typer.Option(metavar="URL", help="Address of the service.  [default: VERSANT_SERVER]")
]


@app.command("upload")
def upload(
    ctx: typer.Context,
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Drive logs, gzipped or not.")],
    server: Server = None,
    method: Annotated[str | None, typer.Option(help="Estimator; without it the service's default.")] = None,
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Option of the method; may be given several times."),
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait until each drive is done or failed.")] = False,
    json_file: JsonFile = None,
) -> None:
    """Upload drive logs to a service; exit status 1 if any of them failed.

    The same bytes again are the same drive: an upload that broke off may simply be repeated.
    """
    console: Console = ctx.obj
    options = parse_assignments(option or [])
    uploads = [Upload(path) for path in files]
    with service_client(server) as client, console.progress() as bars:
        client.get("/healthz")  # a service that is not there is said once, not per file
        for one in uploads:
            _send(client, one, method, options, bars, console)
        if wait:
            for one in uploads:
                _follow(client, one, bars, console)
    rows = [one.figures() for one in uploads]
    console.table(list(rows[0]), [list(row.values()) for row in rows])
    write_json(json_file, {"server": client.server, "uploads": rows})
    if any(one.failed for one in uploads):
        raise typer.Exit(1)


def service_client(server: str | None) -> Client:
    """A client of the service that ``--server`` or the settings name; raises ``typer.BadParameter``."""
    from app.cli.client import Client, ClientError
    from app.core.settings import load_settings

    if server is None:
        return Client(load_settings().server)
    try:
        return Client(server)
    except ClientError as error:
        raise typer.BadParameter(str(error), param_hint="'--server'") from error


@dataclass
class Upload:
    """One file on its way."""

    path: Path
    drive: RemoteDrive | None = None
    reason: str | None = None
    segments: int | None = None

    @property
    def status(self) -> str:
        """The drive's status, or ``not sent``."""
        return self.drive.status if self.drive else "not sent"

    @property
    def failed(self) -> bool:
        """Whether nothing came of it."""
        return self.status in {"not sent", "failed", "cancelled"}

    def figures(self) -> dict[str, Any]:
        """What the table and ``--json`` say."""
        return {
            "file": str(self.path),
            "drive": self.drive.id if self.drive else None,
            "status": self.status,
            "segments": self.segments,
            "reason": self.reason,
        }


def _send(
    client: Client,
    one: Upload,
    method: str | None,
    options: dict[str, Any],
    bars: Bars,
    console: Console,
) -> None:
    try:
        advance = bars.count(f"sending {one.path.name}", one.path.stat().st_size)
        one.drive = client.upload(one.path, method=method, options=options, sent=advance)
    except (FusionError, OSError) as error:
        one.reason = console.complain_of(one.path, error)
    else:
        one.reason = one.drive.reason


def _follow(client: Client, one: Upload, bars: Bars, console: Console) -> None:
    from app.cli.client import shown

    if one.drive is None:
        return
    show = bars.work(f"fusing {one.path.name}")
    one.drive = client.wait(one.drive.id, seen=shown(show))
    one.reason = one.drive.reason
    if one.drive.status == "done":
        one.segments = len(client.drive_segments(one.drive.id))
    elif one.failed:
        console.complain(f"{one.path}: {one.reason or one.status}")
