"""``versant backup``, ``restore``, ``doctor``, ``sweep`` and ``release``: what operators do to look after a service."""

from __future__ import annotations

import time
from dataclasses import asdict
from datetime import datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from app.cli.console import Console, spoken, tell, write_json
from app.cli.database import as_it_is, sessions, settings_for
from app.cli.options import DATA_DIR, JSON_FILE, arg, flag, opt
from app.core.messages import say
from fusion.messages import message_of

if TYPE_CHECKING:
    from app.upkeep.manifest import Manifest

_MIB = 2**20

app = typer.Typer(add_completion=False)

FOLDER = arg("Folder of the backup.", metavar="DIR", file_okay=False)


@app.command("backup")
def backup(
    ctx: typer.Context,
    folder: Path = FOLDER,
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Copy the database, the logs and the elevation rasters of a running service.

    The database as it is at one moment, and every file that it refers to then. Given the same folder again it copies
    what is new and replaces the rest; broken off, it leaves the backup that was there, and goes on the next time.
    """
    from app.upkeep.backup import back_up

    console: Console = ctx.obj
    started = time.perf_counter()
    folder = folder.expanduser().absolute()
    with as_it_is(settings_for(data_dir)) as (settings, factory), console.progress() as bars:
        manifest = back_up(settings, factory, folder, bars.work("backup"))
    seconds = time.perf_counter() - started
    tell("backup.done", folder=folder, what=_backup_summary(manifest), seconds=seconds)
    _warn_of(manifest)
    write_json(json_file, _backup_figures(manifest) | {"folder": str(folder), "seconds": round(seconds, 3)})


@app.command("restore")
def restore(
    ctx: typer.Context,
    folder: Path = FOLDER,
    dry_run: bool = flag("Check every file of the backup, and bring nothing back.", "--dry-run"),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Bring a backup back into an empty database.

    Every file is checked first. Nothing is overwritten: a data folder with a database, or a database that is not empty,
    is refused. Drives that were waiting or being processed wait again. Broken off, it can be done again.
    """
    from app.core import migrate
    from app.upkeep import restore as bringing_back

    console: Console = ctx.obj
    started = time.perf_counter()
    folder = folder.expanduser().absolute()
    named = settings_for(data_dir)
    with console.progress() as bars:
        manifest = bringing_back.checked(folder, bars.work("backup"))
    if dry_run:
        tell("backup.checked", folder=folder, what=_backup_summary(manifest))
        write_json(json_file, _backup_figures(manifest) | {"folder": str(folder), "dry_run": True})
        return
    with as_it_is(named, make=True) as (settings, factory), console.progress() as bars:
        restored = bringing_back.restore(settings, factory, folder, manifest, bars.work("restore"))
        assert settings.database_url is not None  # noqa: S101 - as_it_is() sees to it
        if named.database_url is None:  # the embedded one
            migrate.upgrade(settings.database_url, finish=True)
        standing = migrate.standing_of(settings.database_url)
    seconds = time.perf_counter() - started
    tell("backup.back", what=_backup_summary(manifest), seconds=seconds, waiting=restored.waiting)
    _warn_of(manifest)
    if restored.other_databases:
        tell("backup.others", names=", ".join(restored.other_databases))
    if standing.sentence:
        typer.echo(spoken(standing.sentence))
    figures = _backup_figures(manifest) | asdict(restored)
    write_json(json_file, figures | {"folder": str(folder), "seconds": round(seconds, 3)})


def _backup_summary(manifest: Manifest) -> str:
    from app.upkeep.manifest import LOGS, RASTERS

    logs, rasters = len(manifest.below(LOGS)), len(manifest.below(RASTERS))
    return say(
        "backup.holds",
        drives=manifest.drives,
        logs=logs,
        rasters=rasters,
        segments=manifest.segments,
        made_at=manifest.made_at,
        mib=manifest.size_bytes / _MIB,
    )


def _warn_of(manifest: Manifest) -> None:
    from app.upkeep.manifest import some

    if manifest.missing:
        tell("backup.missing", n=len(manifest.missing), names=some(manifest.missing))
    if manifest.damaged:
        tell("backup.damaged", n=len(manifest.damaged), names=some(manifest.damaged))


def _backup_figures(manifest: Manifest) -> dict[str, Any]:
    names = ("made_at", "versions", "drives", "segments", "size_bytes", "files", "missing", "damaged")
    return {name: getattr(manifest, name) for name in names} | {"files": len(manifest.files)}


@app.command("doctor")
def doctor(ctx: typer.Context, data_dir: Path | None = DATA_DIR, json_file: Path | None = JSON_FILE) -> None:
    """Look for what is wrong with a service; changes nothing.

    Versions, room, database and schema, clocks, queue, cells, logs, elevation, and who reaches the API; each finding
    with what to do. Exit status 1 where something fails, 0 with warnings.
    """
    from app.core.databases import UnreachableError
    from app.upkeep.doctor import Patient, examine

    console: Console = ctx.obj
    named = settings_for(data_dir)
    try:
        with as_it_is(named) as (settings, factory), console.progress() as bars:
            findings = examine(Patient(settings, factory), bars.work("looking"))
    except UnreachableError as error:
        findings = examine(Patient(named, None, message_of(error)))
    rows = [(one.state, one.subject, one.found, one.advice) for one in findings]
    console.table(("", "what", "found", "to do"), [[*map(spoken, row)] for row in rows])
    worst = max(findings, key=lambda one: ("ok", "warn", "fail").index(one.state)).state
    write_json(json_file, {"state": worst, "findings": [asdict(one) for one in findings]})
    if worst == "fail":
        failed = ", ".join(spoken(one.subject) for one in findings if one.state == "fail")
        console.complain(say("doctor.wrong", names=failed))
        raise typer.Exit(1)


@app.command("sweep")
def sweep(
    only_database: bool = flag(
        "No other database uses the store any more, though others have: this one is, say, their restored "
        "backup, and no other backup is to be restored.",
        "--only-database",
    ),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Remove stored logs that no drive refers to any more, and files that no export does.

    Workers do so every hour, for logs older than VERSANT_ORPHAN_DAYS, and for elevation rasters that have been in no
    use for so long. Where other databases have used the store as well nothing is removed and the logs are listed,
    unless --only-database is given; so are rasters that are kept elsewhere than logs, for nobody knows who uses them.
    """
    from app.core.blobs import BlobStore
    from app.drives.intake import sweep_blobs
    from app.exports.run import EXPORT
    from app.jobs.context import JobContext
    from app.jobs.requests.upkeep import sweep_files
    from app.terrain.files import sweep_rasters

    with sessions(data_dir) as (settings, factory):
        blobs = BlobStore(settings.blob_store_url)
        age = timedelta(days=settings.orphan_days)
        swept = sweep_blobs(factory, blobs, age, confirmed=only_database)
        files = sweep_files(EXPORT, JobContext(settings, factory))
        sure = only_database or (settings.keeps_files_together and not swept.strangers)
        rasters = sweep_rasters(factory, settings.dem_dir, age) if sure else []
    if swept.strangers:
        for key in swept.orphans:
            typer.echo(key)
        tell("sweep.stay", n=len(swept.orphans), names=", ".join(swept.strangers))
    else:
        tell("sweep.removed", n=len(swept.orphans))
    if files:
        tell("sweep.files", n=len(files))
    for uri in rasters:
        tell("sweep.raster", name=uri.rpartition("/")[2])
    write_json(json_file, asdict(swept) | {"removed": swept.removed, "rasters": rasters, "exports": files})


@app.command("release")
def release(
    ctx: typer.Context,
    day: datetime | None = opt(
        "The day of the edition; today (UTC) if not given.", "--day", formats=["%Y-%m-%d"]
    ),
    output: Path | None = opt("Folder that the edition's files are written to as well.", "--output"),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Make the next edition of the map for the public, which gives no owner away.

    It tells a segment once VERSANT_PUBLIC_OWNERS owners, and as many more as may work together, have driven it. Workers
    make one every VERSANT_RELEASE_DAYS days by themselves where VERSANT_PUBLIC_MAP is releases. The service goes on.
    """
    from app.releases.keeping import copy_files
    from app.releases.run import in_words
    from app.releases.run import release as make

    console: Console = ctx.obj
    started = time.perf_counter()
    with sessions(data_dir) as (settings, _), console.progress() as bars:
        of_day = None if day is None else day.date()
        edition = make(str(settings.database_url), settings, day=of_day, progress=bars.work("edition"))
        if output is not None:
            copy_files(settings, edition, output)
    seconds = time.perf_counter() - started
    tell("release.took", what=in_words(edition), seconds=seconds)
    write_json(json_file, {**asdict(edition), "day": edition.day.isoformat(), "seconds": round(seconds, 3)})
