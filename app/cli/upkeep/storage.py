"""``versant sweep``: what the workers do to the store of uploaded logs by themselves, seen to by an operator."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from dataclasses import asdict
from datetime import timedelta
from typing import Annotated

import typer

from app.cli.options import DataDir, JsonFile

app = typer.Typer(add_completion=False)


@app.command("sweep")
def sweep(
    only_database: Annotated[
        bool,
        typer.Option(
            "--only-database",
            help="No other database uses the store any more, though others have: this one is, say, their restored "
            "backup, and no other backup is to be restored.",
        ),
    ] = False,
    data_dir: DataDir = None,
    json_file: JsonFile = None,
) -> None:
    """Remove stored logs that no drive refers to any more, and files that no export does.

    Workers do so every hour, for logs older than VERSANT_ORPHAN_DAYS, and for elevation rasters that have been in no
    use for so long. Where other databases have used the store as well nothing is removed and the logs are listed,
    unless --only-database is given; so are rasters that are kept elsewhere than logs, for nobody knows who uses them.
    """
    from app.cli.console import write_json
    from app.cli.database import sessions
    from app.core.blobs import BlobStore
    from app.drives.intake import sweep_blobs
    from app.exports.run import EXPORT
    from app.jobs.context import JobContext
    from app.jobs.requests.upkeep import sweep_files
    from app.terrain.files import sweep_rasters

    with sessions(data_dir) as (settings, factory):
        blobs = BlobStore(settings.blob_store_url)
        age = timedelta(days=settings.orphan_days)
        found = sweep_blobs(factory, blobs, age, confirmed=only_database)
        files = sweep_files(EXPORT, JobContext(settings, factory))
        sure = only_database or (settings.keeps_files_together and not found.strangers)
        rasters = sweep_rasters(factory, settings.dem_dir, age) if sure else []
    if found.strangers:
        for key in found.orphans:
            typer.echo(key)
        typer.echo(
            f"{len(found.orphans)} logs without a drive stay: other databases have used the store "
            f"({', '.join(found.strangers)}). --only-database removes them."
        )
    else:
        typer.echo(f"{len(found.orphans)} logs without a drive removed.")
    if files:
        typer.echo(f"{len(files)} files without an export removed.")
    for uri in rasters:
        typer.echo(f"{uri.rpartition('/')[2]}: this elevation raster is in no use any more and removed.")
    write_json(json_file, asdict(found) | {"removed": found.removed, "rasters": rasters, "exports": files})
