"""What slopes and sigmas rest on: roads, terrain, surveyed heights, repeats, and ``settle`` after a change of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from app.cli.console import Console, spoken, tell, write_json
from app.cli.database import sessions
from app.cli.options import DATA_DIR, JSON_FILE, arg, flag, opt

if TYPE_CHECKING:
    from app.roads.documents import ImportCounts

app = typer.Typer(add_completion=False)


regions_app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="List the regions of the road network, or remove one."
)
app.add_typer(regions_app, name="regions")

repeats_app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Show what repeated drives say of each other's sigmas; widen those that they contradict.",
)
app.add_typer(repeats_app, name="repeats")

REGION_NAME = opt(
    "The region that the file brings up to date; default: the file's name without .osm.pbf and the like.",
    "--region",
    metavar="NAME",
)
DRY_RUN = flag("Say what it would do, and change nothing.", "--dry-run")
YES = flag("Though it takes away what was measured on more than a tenth of a region.", "--yes")


@app.command("import-roads")
def import_roads(
    ctx: typer.Context,
    file: Path = arg(
        "OpenStreetMap extract: .osm.pbf, .osm or .osm.gz; or changes of a region: .osc or .osc.gz."
    ),
    region: str | None = REGION_NAME,
    dry_run: bool = DRY_RUN,
    yes: bool = YES,
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Make the drivable roads of an OpenStreetMap file those of a region; other regions stay as they are.

    What was measured stays with every segment whose ends moved by no more than VERSANT_ROAD_TOLERANCE_M, also where its
    way was renumbered or turned round. What other segments lose is kept for VERSANT_KEEP_DROPPED_DAYS, and comes
    back with its road. Drives on them are computed again by themselves. The service goes on meanwhile.
    """
    from app.roads.imports import import_roads as bring_in

    bring = partial(bring_in, path=file, region=region)
    _change_roads(ctx.obj, file.name, bring, dry_run, yes, data_dir, json_file)


@regions_app.command("list")
def list_regions(data_dir: Path | None = DATA_DIR, json_file: Path | None = JSON_FILE) -> None:
    """Name each region, the file that it came from, and how many of its segments anything was measured on."""
    from app.roads.store import region_figures

    with sessions(data_dir) as (_, factory), factory() as session:
        regions = region_figures(session)
    for one in regions:
        tell("regions.one", **asdict(one) | {"imported_at": f"{one.imported_at:%Y-%m-%d %H:%M}"})
    if not regions:
        tell("regions.none")
    figures = [asdict(one) | {"imported_at": one.imported_at.isoformat()} for one in regions]
    write_json(json_file, {"regions": figures})


@regions_app.command("remove")
def remove_region(
    ctx: typer.Context,
    name: str = arg("As `versant regions list` names it.", metavar="NAME"),
    dry_run: bool = DRY_RUN,
    yes: bool = YES,
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Take a region off the map, but for roads that other regions have; importing it again brings all back in time."""
    from app.roads.imports import remove_region as remove

    _change_roads(ctx.obj, name, partial(remove, name=name), dry_run, yes, data_dir, json_file)


def _change_roads(
    console: Console,
    what: str,
    bring: Callable[..., ImportCounts],
    dry_run: bool,
    yes: bool,
    data_dir: Path | None,
    json_file: Path | None,
) -> None:
    """Do it, queue the drives that lost something, and say what was done."""
    from app.drives.batches.touched import queue_touched
    from app.roads.documents import Wishes, remarks, summary

    started = time.perf_counter()
    with sessions(data_dir, make=console) as (settings, factory), console.progress() as bars:
        wishes = Wishes(dry_run=dry_run, accept_losses=yes, tolerance_m=settings.road_tolerance_m)
        counts = bring(factory, dem_dir=settings.dem_dir, progress=bars.work(what), wishes=wishes)
        if not dry_run:
            queue_touched(factory)
    seconds = time.perf_counter() - started
    tell("cli.took", what=what, summary=summary(counts), seconds=seconds)
    for line in remarks(counts):
        typer.echo(spoken(line))
    figures = {**asdict(counts), "segments": counts.segments, "seconds": round(seconds, 3)}
    write_json(json_file, {"file": what, **figures})


@app.command("import-dem")
def import_dem(
    ctx: typer.Context,
    files: list[Path] = arg(
        "Rasters: GeoTIFF, COG, VRT, HGT; WGS 84 or any CRS. The quality layer X_num.tif of X_dem.tif "
        "goes with it.",
        metavar="FILE...",
    ),
    priority: int | None = opt(
        "Where rasters lie over each other the highest number counts, of one number the finest; 0 unless "
        "given. `versant elevation priority` changes it.",
        metavar="N",
    ),
    source: str | None = opt(
        "Whose data it is, as maps and files are to credit it; else they name the files.", metavar="TEXT"
    ),
    licence: str | None = opt("Its licence, such as 'CC BY 4.0'.", metavar="TEXT"),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Add elevation rasters to the terrain that drives and roads are compared with.

    The rasters are copied, and the service goes on meanwhile. Where one has no height the next one fills, by priority
    and then by resolution; each segment's slope is of one raster wherever one covers it whole. Drives processed
    before keep their estimates until they are processed again; `versant settle` lets the network as a whole take the
    new terrain into account.
    """
    from app.terrain import files as dem_files
    from app.terrain import imports as dem_imports
    from app.terrain.coverage import rasters_over
    from app.terrain.files import operator_limits
    from fusion.terrain.quality import pair

    console: Console = ctx.obj
    started = time.perf_counter()
    with sessions(data_dir, make=console) as (settings, factory), console.progress() as bars:
        stored = dem_files.store_files(files, settings.dem_dir, bars.work("files"), operator_limits(settings))
        said = {"source": source, "licence": licence}
        progress = bars.work("elevation")
        active = dem_imports.add_dem(factory, stored, settings.dem_dir, progress, priority=priority, **said)
        with factory() as session:
            covering = rasters_over(session, active)
    seconds = time.perf_counter() - started
    lonely = sorted({one.name for one in stored} - set(covering))
    with_quality = [path.name for path, quality in pair(active.paths) if quality is not None]
    names = {"n": len(active.names), "names": ", ".join(active.names)}
    tell("elevation.terrain", **names, datum=active.datum, seconds=seconds)
    if with_quality:
        tell("elevation.quality", names=", ".join(with_quality))
    if lonely:
        tell("elevation.lonely", names=", ".join(lonely))
    figures = {
        "rasters": active.names,
        "datum": active.datum,
        "with_quality": with_quality,
        "without_roads": lonely,
    }
    write_json(json_file, {**figures, "seconds": round(seconds, 3)})


@app.command("import-control")
def import_control(
    ctx: typer.Context,
    file: Path = arg(
        "CSV: lat_deg, lon_deg, height_m, and sigma_m where it is known (else 0.1 m); heights above the datum "
        "that the logs use."
    ),
    replace: bool = flag(
        "Let the file's points be all there are; one that has only a header removes all.", "--replace"
    ),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Add surveyed heights to what the network's heights rest on.

    A point belongs to the nearest road within 20 m. The roads around points that are new, changed or gone are solved
    again; what lies farther away follows when it is solved next, by `versant settle` at the latest.
    """
    from app.network.control_import import import_control as import_points
    from fusion.network.control import read_control

    console: Console = ctx.obj
    points = read_control(file)
    with sessions(data_dir) as (_, factory), console.progress() as bars:
        counts = import_points(factory, points, replace=replace, progress=bars.work(file.name))
    tell("control.added", file=file.name, **asdict(counts))
    if counts.without_road:
        tell("control.without_road", n=counts.without_road)
    write_json(json_file, {"file": str(file), **asdict(counts)})


@app.command("settle")
def settle(
    ctx: typer.Context,
    by_workers: bool = flag("Leave it to the workers of all machines, side by side.", "--by-workers"),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Compute the slopes of the whole network anew from what the drives contributed.

    Wanted after an elevation import, which by itself changes no slope, and after an update of Versant that
    changes how drives are put together. Drives are not processed again, and may come and go meanwhile.
    With --by-workers it ends at once, and workers settle cell by cell whenever no drive waits.
    """
    from app.drives.publishing import SETTLE_AFTER_S
    from app.network.settle import leave_to_workers, settle_network

    console: Console = ctx.obj
    started = time.perf_counter()
    if by_workers:
        with sessions(data_dir) as (_, factory):
            cells = leave_to_workers(factory, SETTLE_AFTER_S)
        tell("settle.cells", n=cells)
        write_json(json_file, {"cells": cells})
        return
    with sessions(data_dir) as (_, factory), console.progress() as bars:
        segments = settle_network(factory, bars.work("network"))
    seconds = time.perf_counter() - started
    tell("settle.done", n=segments, seconds=seconds)
    write_json(json_file, {"segments": segments, "seconds": round(seconds, 3)})


@repeats_app.command("show")
def show(ctx: typer.Context, data_dir: Path | None = DATA_DIR, json_file: Path | None = JSON_FILE) -> None:
    """Show how far drives over one segment are apart, in their own sigmas, and the widenings that are applied."""
    from app.network.widenings import device_classes, repeat_rows

    with sessions(data_dir) as (_, factory), factory() as session:
        rows, classes = repeat_rows(session), device_classes(session)
    for row in rows:
        tell("repeats.row", **row | {"kind": f"{row['kind']:10}", "group": f"{row['group']:24}"})
    if not rows:
        tell("repeats.none")
    _tell(classes)
    write_json(json_file, {"repeats": rows, "classes": _plain(classes)})


@repeats_app.command("learn")
def learn(ctx: typer.Context, data_dir: Path | None = DATA_DIR, json_file: Path | None = JSON_FILE) -> None:
    """Learn by how much the sigmas of each device class are too small, and widen them from now on.

    Where a widening changes by more than 5 %, the cells of its drives are marked, and the workers solve them when no
    drive waits. Drives may come and go meanwhile; what is interrupted is finished by the next call.
    """
    from app.network import widenings

    _change(ctx.obj, widenings.learn, data_dir, json_file)


@repeats_app.command("reset")
def reset(ctx: typer.Context, data_dir: Path | None = DATA_DIR, json_file: Path | None = JSON_FILE) -> None:
    """Set all widenings to 1: drives are taken at their word again, until the next `versant repeats learn`."""
    from app.network import widenings

    _change(ctx.obj, widenings.reset, data_dir, json_file)


def _change(
    console: Console,
    change: Callable[..., list[dict[str, Any]]],
    data_dir: Path | None,
    json_file: Path | None,
) -> None:
    with sessions(data_dir) as (_, factory), console.progress() as bars:
        classes = change(factory, bars.work("repeats"))
    _tell(classes)
    write_json(json_file, {"classes": _plain(classes)})


def _tell(classes: list[dict[str, Any]]) -> None:
    from app.network.widenings import sentence

    for one in classes:
        tell("repeats.class", **one)
    typer.echo(spoken(sentence(classes)))


def _plain(classes: list[dict[str, Any]]) -> list[dict[str, Any]]:
    from app.core.text import utc_text

    return [{**one, "learned_at": utc_text(one["learned_at"])} for one in classes]
