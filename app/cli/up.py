"""``versant up``: the whole service in one process tree, on an embedded database."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from app.cli.console import Console
from app.cli.database import settings_for
from app.cli.supervisor import Service, reach, stop_signals
from app.core.settings import Settings
from app.embedded.access import open_cluster

app = typer.Typer(add_completion=False)


@app.command("up")
def up(
    ctx: typer.Context,
    data_dir: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            file_okay=False,
            help="Folder of the database, the uploads and the rasters; made if it is missing. "
            "Default: VERSANT_DATA_DIR, else ~/.local/share/versant.",
            show_default=False,
        ),
    ] = None,
    port: Annotated[
        int | None, typer.Option(min=0, max=65535, help="TCP port, 0 for any free one.  [default: 8000]")
    ] = None,
    host: Annotated[
        str | None, typer.Option(help="Address to listen on.  [default: 127.0.0.1, this machine alone]")
    ] = None,
) -> None:
    """Start everything: embedded PostgreSQL + PostGIS, migrations, API and worker. Ctrl-C stops it.

    While it runs, `versant import-roads`, `import-dem`, `export` (with the same --data-dir) and `upload` work
    beside it.
    """
    console: Console = ctx.obj
    settings = settings_for(data_dir, port=port, host=host)
    with stop_signals():
        console.note(f"Starting in {settings.data_dir} ...")
        with open_cluster(settings) as cluster:
            ready = settings.model_copy(update={"database_url": cluster.url})
            with Service(ready, console, cluster) as service:
                for line in welcome(service, settings):
                    typer.echo(line)
                service.serve_forever()
    console.note("Stopped.")


def welcome(service: Service, settings: Settings) -> list[str]:
    """What to open and what to do next."""
    home = f"--data-dir {settings.data_dir}"
    server = f"--server {service.address}"
    return [
        f"Versant is ready at {service.address}  (described at {service.address}/openapi.json)",
        reach(settings),
        f"  versant import-roads {home} FILE.osm.pbf",
        f"  versant import-dem {home} FILE...",
        f"  versant upload {server} --wait LOG...",
        "Ctrl-C stops it.",
    ]
