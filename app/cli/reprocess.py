"""``versant reprocess``: all drives again, by another method."""

from __future__ import annotations

from typing import Annotated

import typer

from app.cli.client import RemoteBatch
from app.cli.console import Console, write_json
from app.cli.options import JsonFile
from app.cli.remote import Server, service_client

app = typer.Typer(add_completion=False)


@app.command("reprocess")
def reprocess(
    ctx: typer.Context,
    server: Server = None,
    method: Annotated[str | None, typer.Option(help="Estimator; without it the service's default.")] = None,
    from_method: Annotated[
        str | None, typer.Option(metavar="NAME", help="Only drives that were processed by this method.")
    ] = None,
    wait: Annotated[bool, typer.Option("--wait", help="Wait until each drive is done or failed.")] = False,
    json_file: JsonFile = None,
) -> None:
    """Let a service process every drive again that is of another method; exit status 1 if any failed.

    What a drive published stays until its new run replaces it; uploads go first.
    """
    console: Console = ctx.obj
    with service_client(server) as client, console.progress() as bars:
        batch = client.reprocess_all(method, from_method)
        typer.echo(f"{batch.drives} drive(s) are processed again.")
        if wait:
            show = bars.work("reprocessing")

            def seen(batch: RemoteBatch) -> None:
                show(f"{batch.finished} of {batch.drives}", batch.progress)

            batch = client.wait_for_batch(batch, seen)
            typer.echo(f"{batch.done} done, {batch.failed} failed.")
    write_json(json_file, {"server": client.server, "drives": batch.drives, "failed": batch.failed})
    if batch.failed:
        raise typer.Exit(1)
