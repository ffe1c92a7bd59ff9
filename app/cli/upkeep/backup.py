"""``versant backup`` and ``versant restore``."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.console import Console, write_json
from app.cli.options import DataDir, JsonFile

if TYPE_CHECKING:
    from app.upkeep.manifest import Manifest

_MIB = 2**20

app = typer.Typer(add_completion=False)

Folder = Annotated[Path, typer.Argument(metavar="DIR", file_okay=False, help="Folder of the backup.")]


@app.command("backup")
def backup(ctx: typer.Context, folder: Folder, data_dir: DataDir = None, json_file: JsonFile = None) -> None:
    """Copy the database, the logs and the elevation rasters of a running service.

    The database as it is at one moment, and every file that it refers to then. Given the same folder again it copies
    what is new and replaces the rest; broken off, it leaves the backup that was there, and goes on the next time.
    """
    from app.cli.database import as_it_is, settings_for
    from app.upkeep.backup import back_up

    console: Console = ctx.obj
    started = time.perf_counter()
    folder = folder.expanduser().absolute()
    chosen, embedded = settings_for(data_dir), True if data_dir else None
    with as_it_is(chosen, embedded=embedded) as (settings, factory), console.progress() as bars:
        manifest = back_up(settings, factory, folder, bars.work("backup"))
    seconds = time.perf_counter() - started
    typer.echo(f"{folder}: {_summary(manifest)}, in {seconds:.1f} s.")
    for line in _remarks(manifest):
        typer.echo(line)
    write_json(json_file, _figures(manifest) | {"folder": str(folder), "seconds": round(seconds, 3)})


@app.command("restore")
def restore(
    ctx: typer.Context,
    folder: Folder,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Check every file of the backup, and bring nothing back.")
    ] = False,
    data_dir: DataDir = None,
    json_file: JsonFile = None,
) -> None:
    """Bring a backup back into an empty database.

    Every file is checked first. Nothing is overwritten: a data folder with a database, or a database that is not empty,
    is refused. Drives that were waiting or being processed wait again. Broken off, it can be done again.
    """
    from app.cli.database import as_it_is, settings_for
    from app.core import migrate
    from app.upkeep import restore as bringing_back

    console: Console = ctx.obj
    started = time.perf_counter()
    folder = folder.expanduser().absolute()
    chosen = settings_for(data_dir)
    embedded = data_dir is not None or chosen.database_url is None
    with console.progress() as bars:
        manifest = bringing_back.checked(folder, bars.work("backup"))
    if dry_run:
        typer.echo(f"{folder}: {_summary(manifest)}; every file is as it was.")
        write_json(json_file, _figures(manifest) | {"folder": str(folder), "dry_run": True})
        return
    with as_it_is(chosen, embedded=embedded, make=True) as (settings, factory), console.progress() as bars:
        found = bringing_back.restore(settings, factory, folder, manifest, bars.work("restore"))
        assert settings.database_url is not None  # noqa: S101 - as_it_is() sees to it
        if embedded:
            migrate.upgrade(settings.database_url, finish=True)
        standing = migrate.standing_of(settings.database_url)
    seconds = time.perf_counter() - started
    typer.echo(
        f"{_summary(manifest)} are back, in {seconds:.1f} s. {found.waiting} drives wait to be processed."
    )
    for line in _remarks(manifest):
        typer.echo(line)
    if found.other_databases:
        typer.echo(
            f"Other databases have used the store of logs ({', '.join(found.other_databases)}): nothing is removed "
            "there until `versant sweep --only-database` says that they are gone."
        )
    if standing.sentence:
        typer.echo(standing.sentence)
    write_json(
        json_file, _figures(manifest) | asdict(found) | {"folder": str(folder), "seconds": round(seconds, 3)}
    )


def _summary(manifest: Manifest) -> str:
    from app.upkeep.manifest import LOGS, RASTERS

    logs, rasters = len(manifest.below(LOGS)), len(manifest.below(RASTERS))
    return (
        f"{manifest.drives} drives, {logs} logs, {rasters} files of rasters and {manifest.segments} segments of "
        f"{manifest.made_at}, {manifest.size_bytes / _MIB:.1f} MiB"
    )


def _remarks(manifest: Manifest) -> list[str]:
    from app.upkeep.manifest import some

    lines = []
    if manifest.missing:
        lines.append(
            f"Warning: {len(manifest.missing)} logs are not in the store and not in the backup: "
            f"{some(manifest.missing)}. Their drives keep what they said; uploading a log again gives it back."
        )
    if manifest.damaged:
        lines.append(
            f"Warning: {len(manifest.damaged)} logs are not as they were uploaded: {some(manifest.damaged)}. They are "
            "in the backup as they are; look at the disk that they are on."
        )
    return lines


def _figures(manifest: Manifest) -> dict[str, Any]:
    said = {
        name: getattr(manifest, name) for name in ("made_at", "versions", "drives", "segments", "size_bytes")
    }
    return said | {"files": len(manifest.files), "missing": manifest.missing, "damaged": manifest.damaged}
