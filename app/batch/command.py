"""``versant batch``: archives of logs in bulk, by many processes; ``import-batch``: its result for a service."""
# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import app.cli.options as cli
from app.cli.console import Console, spoken, tell, write_json
from app.cli.database import sessions
from app.cli.uploads.choice import asked_sports
from app.core.messages import say
from fusion.registry import DEFAULT_METHOD, DEFAULT_POSITIONING

if TYPE_CHECKING:
    from app.batch.bringing import Brought
    from app.batch.run import Done

app = typer.Typer(add_completion=False)

MOST_NAMED = 20
"""Failed logs that are named on the screen; the report names all."""


@app.command("batch")
def batch(
    ctx: typer.Context,
    logs: list[str] = cli.arg(
        "Logs: folders with all that is in them, zips of logs, files, addresses such as s3://bucket/logs. A zip in a "
        "folder or a zip is one drive of the files in it.",
        metavar="LOGS...",
    ),
    roads: Path = cli.ROADS,
    dem: list[Path] | None = cli.opt(
        "Elevation rasters, as of `versant fuse`; give the option once for each.", metavar="FILE"
    ),
    method: str = cli.opt("Estimator; `versant methods` lists them.", default=DEFAULT_METHOD),
    option: list[str] | None = cli.METHOD_OPTION,
    gnss: str = cli.gnss_name(DEFAULT_POSITIONING),
    gnss_option: list[str] | None = cli.GNSS_OPTION,
    columns: list[str] | None = cli.COLUMNS_OPTION,
    sports: list[str] | None = cli.opt(
        "Leave out logs that tell of another sport: `roads` stands for cycling, driving and motorcycling; may be given "
        "several times. Default: take all.",
        metavar="NAME",
    ),
    control: Path | None = cli.CONTROL,
    gaps: bool = cli.GAPS,
    formats: str = cli.opt(
        "Files of slopes, by names of formats, with commas between.",
        default="geoparquet,pmtiles",
        metavar="NAMES",
    ),
    out: Path = cli.opt(
        "Folder of all results, also of those in between: the same command goes on where it was cut off.",
        "-o",
        "--out",
        default=...,
        metavar="FOLDER",
        file_okay=False,
    ),
    scheduler: str | None = cli.opt(
        "Dask's scheduler, whose workers reach FOLDER, logs and rasters by the same paths. Default: workers of this "
        "machine.",
        metavar="tcp://HOST:PORT",
    ),
    processes: int | None = cli.opt("Workers of this machine. Default: its cores.", min=1),
    memory: str | None = cli.opt(
        "What each of them may take, such as 4GB. Default: equal parts of the machine's.", metavar="SIZE"
    ),
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Fuse archives of logs into segment slopes, without a server or a database.

    Gives the numbers of `versant fuse` for any number of logs. A log that fails is reported, and the others go on.
    """
    from app.batch.folder import BatchFolder
    from app.batch.hands import hands
    from app.batch.run import Request, run

    console: Console = ctx.obj
    options = cli.usable_options(
        method, cli.parse_columns(columns) if columns else {}, option, gnss, gnss_option
    )
    request = Request(
        logs=tuple(logs),
        roads=roads,
        rasters=tuple(dem or ()),
        method=method,
        options=options.model_dump(mode="json"),
        control=control,
        gaps=gaps,
        formats=_formats(formats),
        sports=tuple(sorted(asked_sports(sports))) if sports else None,
    )
    if scheduler is not None and (processes or memory):
        raise typer.BadParameter(spoken(say("batch.scheduler")), param_hint="--scheduler")
    folder = BatchFolder(out.absolute())
    with (
        folder.held(),
        hands(scheduler, processes, memory) as workers,
        console.progress() as bars,
    ):
        done = run(request, folder, workers, bars)
    counted = _tell(done, console, folder.report)
    write_json(json_file, counted)
    if counted["failed"]:
        raise typer.Exit(1)


def _formats(names: str) -> tuple[str, ...]:
    from app.batch.outputs import formats_of_segments

    wanted = tuple(dict.fromkeys(name.strip() for name in names.split(",")))
    known = formats_of_segments()
    for name in wanted:
        if name not in known:
            raise typer.BadParameter(
                spoken(say("batch.no_format", name=name, names=", ".join(known))), param_hint="--formats"
            )
    return wanted


def _tell(done: Done, console: Console, report: Path) -> dict[str, Any]:
    """Say what came of it; the figures."""
    failed = [one for one in done.outcomes if one.status == "failed"]
    for one in failed[:MOST_NAMED]:
        console.complain(say("cli.of_file", file=one.log, note=one.reason))
    if len(failed) > MOST_NAMED:
        console.complain(say("batch.more_failed", n=len(failed) - MOST_NAMED, report=report))
    solution = done.solution
    segments, remarks = (0, []) if solution is None else (len(solution), solution.remarks)
    console.warn("", remarks)
    for note in done.notes:
        console.note(note)
    count = Counter(one.status for one in done.outcomes)
    for path in done.files:
        console.note(say("batch.written", file=path, n=segments, logs=count["done"], all=len(done.outcomes)))
    return {
        "logs": len(done.outcomes),
        **{status: count[status] for status in ("done", "repeated", "failed")},
        "duplicates": sum(one.duplicate_of is not None for one in done.outcomes),
        "segments": segments,
        "height_datum": None if solution is None else solution.height_datum,
        "remarks": remarks,
        "files": [str(path) for path in done.files],
        "report": str(report),
    }


@app.command("import-batch")
def import_batch(
    ctx: typer.Context,
    folder: Path = cli.arg("What `versant batch -o` names.", metavar="FOLDER", file_okay=False),
    owner: str = cli.opt("Whose drives they are.", default=..., metavar="NAME"),
    dry_run: bool = cli.flag("Say what it would do, and change nothing.", "--dry-run"),
    without_logs: bool = cli.flag(
        "Bring in drives whose logs are not reached, too: they keep what they say, and cannot be computed again.",
        "--without-logs",
    ),
    undo: bool = cli.flag("Remove all drives that imports of this folder brought in, instead.", "--undo"),
    data_dir: Path | None = cli.DATA_DIR,
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Bring the drives of a batch into a service, as if their logs had been uploaded.

    Logs are stored, and drives taken as they were computed where the service would find the same; the workers compute
    the others, behind uploads. What the owner has already is not brought in twice: cut off, it goes on. The service
    goes on meanwhile. Logs that failed in the batch stay out.
    """
    from app.batch.archive import Archive
    from app.batch.bringing import Asked, bring, take_back
    from app.batch.folder import BatchFolder
    from app.cli.keys.finding import the_owner
    from app.drives.batches.importing import on_behalf_of
    from app.jobs.context import JobContext

    console: Console = ctx.obj
    of_batch = BatchFolder(folder.absolute())
    archive = Archive.read(of_batch)
    with sessions(data_dir) as (settings, factory), of_batch.held(), console.progress() as bars:
        with factory() as session:
            owner_id = the_owner(session, owner).id
        context = JobContext(settings, factory)
        with on_behalf_of(factory, owner_id):
            if undo:
                removed = take_back(context, archive)
            else:
                brought = bring(context, archive, Asked(dry_run, without_logs), bars)
    if undo:
        tell("batch.removed", n=removed)
        write_json(json_file, {"removed": removed})
        return
    _tell_brought(brought, console, dry_run)
    write_json(json_file, {**vars(brought), "dry_run": dry_run})
    if brought.left_out:
        raise typer.Exit(1)


def _tell_brought(brought: Brought, console: Console, dry_run: bool) -> None:
    """Say what came of it."""
    for name, why in [*brought.left_out.items()][:MOST_NAMED]:
        console.complain(say("cli.of_file", file=name, note=why))
    if len(brought.left_out) > MOST_NAMED:
        console.complain(say("batch.more_left_out", n=len(brought.left_out) - MOST_NAMED))
    come, are = ("would come", "would be") if dry_run else ("came", "are")
    tell(
        "batch.brought",
        n=brought.as_computed,
        come=come,
        computed=brought.to_compute.total(),
        are=are,
        there=brought.there,
        left_out=len(brought.left_out),
        failed=brought.failed,
    )
    for why, count in brought.to_compute.items():
        tell("batch.because", n=count, are=are, why=why)
    if brought.without_log:
        tell("batch.without_logs", n=brought.without_log, are=are)
    if brought.number is not None:
        tell("batch.import", number=brought.number)


@app.command("export-logs")
def export_logs(
    ctx: typer.Context,
    folder: Path = cli.arg(
        "Where to: an empty folder, or one that this command has filled.", metavar="FOLDER", file_okay=False
    ),
    owner: str | None = cli.opt("Only logs of this owner.", metavar="NAME"),
    data_dir: Path | None = cli.DATA_DIR,
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Write the logs of a service as an archive that `versant batch` reads: a folder for each owner.

    The same folder again gets what is new, and loses what was removed since; cut off, it goes on. The service goes on
    meanwhile. Exit status 1 if a log is missing or damaged.
    """
    from app.batch import logs_out
    from app.cli.keys.finding import the_owner
    from app.core.blobs import BlobStore

    console: Console = ctx.obj
    with sessions(data_dir) as (settings, factory), console.progress() as bars:
        with factory() as session:
            owner_id = None if owner is None else the_owner(session, owner).id
        blobs = BlobStore(settings.blob_store_url)
        found = logs_out.export_logs(factory, blobs, folder.absolute(), owner_id, bars)
    for drive, why in found.left_out.items():
        console.complain(say("batch.drive", id=drive, why=why))
    tell(
        "batch.logs_out",
        folder=folder,
        n=found.logs.total(),
        owners=len(found.logs),
        new=found.new,
        removed=found.removed,
    )
    write_json(json_file, vars(found))
    if found.left_out:
        raise typer.Exit(1)
