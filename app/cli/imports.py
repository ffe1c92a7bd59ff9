"""What the service's slopes rest on: roads, terrain and surveyed heights, and ``settle`` after a change of them."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.console import Console, write_json
from app.cli.options import DataDir, JsonFile

if TYPE_CHECKING:
    from app.roads.imports import ImportCounts

app = typer.Typer(add_completion=False)


@app.command("import-roads")
def import_roads(
    ctx: typer.Context,
    file: Annotated[Path, typer.Argument(help="OpenStreetMap extract: .osm.pbf, .osm or .osm.gz.")],
    data_dir: DataDir = None,
    json_file: JsonFile = None,
) -> None:
    """Make the drivable roads of an OpenStreetMap file the road network.

    Slopes stay with every segment whose way, nodes and geometry are unchanged; segments that the file
    does not have are dropped.
    """
    from app.cli.database import sessions
    from app.roads import imports as road_imports

    console: Console = ctx.obj
    started = time.perf_counter()
    with sessions(data_dir, make=console) as (settings, factory), console.progress() as bars:
        counts = road_imports.import_roads(factory, file, settings.dem_dir, bars.work(file.name))
    seconds = time.perf_counter() - started
    segments = counts.kept + counts.moved + counts.added
    typer.echo(
        f"{file.name}: {segments} segments ({counts.kept} kept, {counts.moved} moved, {counts.added} added; "
        f"{counts.dropped} dropped) in {seconds:.1f} s."
    )
    for line in remarks(counts):
        typer.echo(line)
    figures = {"file": str(file), "segments": segments, **asdict(counts), "seconds": round(seconds, 3)}
    write_json(json_file, figures)


@app.command("import-dem")
def import_dem(
    ctx: typer.Context,
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE...",
            help="Rasters: GeoTIFF, COG, VRT, HGT; WGS 84 or any CRS. The quality layer X_num.tif of X_dem.tif "
            "goes with it.",
        ),
    ],
    priority: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Where rasters lie over each other the highest number counts, of one number the finest; 0 unless "
            "given. `versant elevation priority` changes it.",
            show_default=False,
        ),
    ] = None,
    data_dir: DataDir = None,
    json_file: JsonFile = None,
) -> None:
    """Add elevation rasters to the terrain that drives and roads are compared with.

    The rasters are copied, and the service goes on meanwhile. Where one has no height the next one fills, by priority
    and then by resolution; each segment's slope is of one raster wherever one covers it whole. Drives processed
    before keep their estimates until they are processed again; `versant settle` lets the network as a whole take the
    new terrain into account.
    """
    from app.cli.database import sessions
    from app.terrain import files as dem_files
    from app.terrain import imports as dem_imports
    from app.terrain.coverage import rasters_over
    from fusion.terrain.quality import pair

    console: Console = ctx.obj
    started = time.perf_counter()
    with sessions(data_dir, make=console) as (settings, factory), console.progress() as bars:
        stored = dem_files.store_files(files, settings.dem_dir, bars.work("files"))
        active = dem_imports.add_dem(
            factory, stored, settings.dem_dir, bars.work("elevation"), priority=priority
        )
        with factory() as session:
            covering = rasters_over(session, active)
    seconds = time.perf_counter() - started
    lonely = sorted({source.name for source in stored} - set(covering))
    with_quality = [path.name for path, quality in pair(active.paths) if quality is not None]
    typer.echo(
        f"The terrain consists of {len(active.names)} raster(s), heights above {active.datum}: "
        f"{', '.join(active.names)} ({seconds:.1f} s)."
    )
    if with_quality:
        typer.echo(f"With a quality layer (option dem_min_quality): {', '.join(with_quality)}.")
    if lonely:
        typer.echo(
            f"Warning: no road that is imported lies under {', '.join(lonely)}. Check the place, or import the roads "
            "there; until then it changes nothing."
        )
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
    file: Annotated[
        Path,
        typer.Argument(
            help="CSV: lat_deg, lon_deg, height_m, and sigma_m where it is known (else 0.1 m); heights above the datum "
            "that the logs use.",
        ),
    ],
    replace: Annotated[
        bool,
        typer.Option(
            "--replace",
            help="Let the file's points be all there are; one that has only a header removes all.",
        ),
    ] = False,
    data_dir: DataDir = None,
    json_file: JsonFile = None,
) -> None:
    """Add surveyed heights to what the network's heights rest on.

    A point belongs to the nearest road within 20 m. The roads around points that are new, changed or gone are solved
    again; what lies farther away follows when it is solved next, by `versant settle` at the latest.
    """
    from app.cli.database import sessions
    from app.network.control_import import import_control as import_points
    from fusion.network.control import read_control

    console: Console = ctx.obj
    points = read_control(file)
    with sessions(data_dir) as (_, factory), console.progress() as bars:
        counts = import_points(factory, points, replace=replace, progress=bars.work(file.name))
    typer.echo(
        f"{file.name}: {counts.added} points added, {counts.changed} changed, {counts.unchanged} as they were, "
        f"{counts.removed} removed; {counts.segments} segments solved again."
    )
    if counts.without_road:
        typer.echo(f"{counts.without_road} points lie more than 20 m from any road and wait for one.")
    write_json(json_file, {"file": str(file), **asdict(counts)})


@app.command("settle")
def settle(ctx: typer.Context, data_dir: DataDir = None, json_file: JsonFile = None) -> None:
    """Compute the slopes of the whole network anew from what the drives contributed.

    Wanted after an elevation import, which by itself changes no slope, and after an update of Versant that
    changes how drives are put together. Drives are not processed again, and may come and go meanwhile.
    """
    from app.cli.database import sessions
    from app.network.settle import settle_network

    console: Console = ctx.obj
    started = time.perf_counter()
    with sessions(data_dir) as (_, factory), console.progress() as bars:
        segments = settle_network(factory, bars.work("network"))
    seconds = time.perf_counter() - started
    typer.echo(f"{segments} segments of the network in {seconds:.1f} s.")
    write_json(json_file, {"segments": segments, "seconds": round(seconds, 3)})


def remarks(counts: ImportCounts) -> list[str]:
    """What a road import cost and what it could not use, a sentence each."""
    lines = []
    if counts.measured_lost:
        lines.append(
            f"{counts.measured_lost} segments lost measured slopes, because they or the roads that lead to them were "
            f"moved or dropped, from {counts.drives_affected} drive(s); reprocess those drives to measure again."
        )
    if counts.skipped:
        reasons = ", ".join(f"{reason}: {count}" for reason, count in sorted(counts.skipped.items()))
        lines.append(
            f"{sum(counts.skipped.values())} node pairs of the file's roads are no segments ({reasons})."
        )
    return lines
