"""``versant fuse``: slopes from files, without a server and without a database."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.console import Bars, Console, write_json
from app.cli.logs import LogFiles, LogNames, Together, drives_of
from app.cli.options import (
    GnssName,
    GnssOption,
    JsonFile,
    MapFile,
    MapScale,
    in_a_folder,
    parse_assignments,
    usable_map,
    usable_picture,
)
from fusion.errors import BadOptionsError, FusionError, UnknownNameError
from fusion.registry import DEFAULT_METHOD, DEFAULT_POSITIONING

if TYPE_CHECKING:
    from app.cli.fuse_files import Combined, FusedLog, Fusion
    from app.map.segment import Segment
    from fusion.methods.base import Options

app = typer.Typer(add_completion=False)

RASTER_SUFFIXES = (".hgt", ".tif", ".tiff", ".vrt")


@app.command("fuse")
def fuse(
    ctx: typer.Context,
    logs: LogNames,
    roads: Annotated[
        Path, typer.Option(metavar="FILE", help="OpenStreetMap roads: .osm, .osm.gz, .osm.pbf.")
    ],
    dem: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE...",
            help="Elevation rasters (GeoTIFF, HGT ...); may be given several times. The quality layer of X_dem.tif, "
            "X_num.tif, is found beside it.",
        ),
    ] = None,
    method: Annotated[str, typer.Option(help="Estimator; `versant methods` lists them.")] = DEFAULT_METHOD,
    option: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=VALUE", help="Option of the method; may be given several times."),
    ] = None,
    gnss: GnssName = DEFAULT_POSITIONING,
    gnss_option: GnssOption = None,
    together: Together = False,
    control: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.csv",
            help="Surveyed heights: lat_deg, lon_deg, height_m, sigma_m (0.1 where not stated), above the logs' datum.",
        ),
    ] = None,
    gaps: Annotated[
        bool, typer.Option("--gaps", help="Give undriven segments between driven ones a slope as well.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            help="Segments: .geojson, .parquet, .gpkg or .csv; without it GeoJSON on stdout.",
            callback=in_a_folder,
        ),
    ] = None,
    profile: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.png",
            help="Elevation profile: .png, .pdf or .svg; one per log, numbered if several.",
            callback=in_a_folder,
        ),
    ] = None,
    track: Annotated[
        Path | None,
        typer.Option(
            metavar="OUT.geojson",
            help="Estimated track; one per log, numbered if several.",
            callback=in_a_folder,
        ),
    ] = None,
    map_file: MapFile = None,
    scale: MapScale = None,
    json_file: JsonFile = None,
) -> None:
    """Fuse logs with roads and terrain into segment slopes, without a server or a database.

    Gives the service's numbers for the same logs. A log that fails is reported, and the others go on.
    """
    from app.cli.fuse_files import Fusion
    from app.map.attribution import attribution
    from app.map.outputs import stated, write
    from app.map.outputs.geojson import collection_chunks
    from fusion.network.control import read_control
    from fusion.roads.osm import read_roads
    from fusion.terrain.dem import Dem

    console: Console = ctx.obj
    chosen = _usable(method, option or [], gnss, gnss_option or [], out)
    usable_map(map_file, scale)
    usable_picture(profile, "--profile")
    logs, dem = _apart(logs, dem or [])
    with ExitStack() as stack:
        points = read_control(control) if control else []
        bars = stack.enter_context(console.progress())
        terrain = stack.enter_context(Dem.open(dem)) if dem else None
        table = read_roads(roads, bars.work(roads.name))
        fusion = Fusion(method, chosen, table, terrain, points)
        drives = drives_of(logs, together)
        outcomes = [_one(fusion, source, console, bars) for source in drives]
        said = fusion.solve(gaps=gaps)
    features, datum = said.features, said.height_datum
    _agreement(fusion, said, outcomes, console)
    source = attribution(terrain.names if terrain else ())
    if fusion.fused and out is None:
        sys.stdout.writelines(collection_chunks(features, stated(source, datum)))
    elif fusion.fused and out is not None:
        write(features, out, source=source, height_datum=datum)
        console.note(f"{out}: {len(features)} segments from {len(fusion.fused)} of {len(drives)} logs.")
    if fusion.fused and map_file is not None:
        _map(fusion, features, map_file, source, scale)
        console.note(f"{map_file}: map of the slopes.")
    for number, one in enumerate(fusion.fused, 1):
        _pictures(one, number if len(fusion.fused) > 1 else None, profile, track, console)
    figures = {
        "method": method,
        "segments": len(features),
        "height_datum": datum,
        "remarks": said.remarks,
    }
    write_json(json_file, {**figures, "logs": outcomes})
    if any(outcome["status"] == "failed" for outcome in outcomes):
        raise typer.Exit(1)


def _apart(logs: list[Path], dem: list[Path]) -> tuple[list[Path], list[Path]]:
    """Logs and rasters: of ``--dem A B`` the parser takes A, and B, which no log is called like, is one too."""
    more = [path for path in logs if dem and path.name.lower().removesuffix(".gz").endswith(RASTER_SUFFIXES)]
    rest = [path for path in logs if path not in more]
    if not rest:
        raise typer.BadParameter("no log is named, only elevation rasters.", param_hint="LOG...")
    return rest, dem + more


def _usable(method: str, option: list[str], gnss: str, gnss_option: list[str], out: Path | None) -> Options:
    """Check what can be checked before the work starts; a wrong name is wrong usage."""
    from app.map.outputs import output_for
    from fusion.pipeline import parse_options

    try:
        if out is not None:
            output_for(out)
        positioning = {"gnss": gnss, "gnss_options": parse_assignments(gnss_option)}
        return parse_options(method, {**positioning, **parse_assignments(option)})
    except (UnknownNameError, BadOptionsError) as error:
        raise typer.BadParameter(str(error)) from error


def _one(fusion: Fusion, source: LogFiles, console: Console, bars: Bars) -> dict[str, Any]:
    from app.cli.fuse_files import summary

    try:
        twin = fusion.twin(source)
        if twin is not None:
            console.note(f"{source.name}: the same bytes as {twin}, counted once.")
            return {
                "file": source.name,
                "status": "repeated",
                "reason": f"the same bytes as {twin}",
                "segments": 0,
            }
        outcome = summary(fusion.add(source, bars.work(source.short_name)))
        for why in () if outcome["segments"] else outcome["report"]["warnings"]:
            console.note(f"{source.name}: {why}")
        return outcome
    except (FusionError, OSError) as error:
        if console.debug:
            raise
        reason = console.complain_of(source.name, error)
        return {"file": source.name, "status": "failed", "reason": reason, "segments": 0}


def _agreement(fusion: Fusion, together: Combined, outcomes: list[dict[str, Any]], console: Console) -> None:
    """Say of each log how it agrees with the others, in its outcome and, where a person must know it, aloud."""
    done = [outcome for outcome in outcomes if outcome["status"] == "done"]
    for k, (outcome, count) in enumerate(zip(done, together.rejected, strict=True)):
        outcome["rejected_segments"] = count
        if k in together.repeated:
            said = f"The same drive as {fusion.fused[together.repeated[k]].source.name}: heard once, from that log."
            console.note(f"{fusion.fused[k].source.name}: {said}")
            outcome["report"]["warnings"].append(said)
    for remark in together.remarks:
        console.note(remark)


def _map(fusion: Fusion, features: Sequence[Segment], path: Path, source: str, scale: float | None) -> None:
    from app.map.map_file import map_of_segments

    count = len(fusion.fused)
    title = f"Slopes from {fusion.fused[0].source.short_name if count == 1 else f'{count} drives'}"
    map_of_segments(
        path, features, fusion.roads, fusion.surroundings(), title=title, source=source, scale=scale
    )


def _pictures(
    one: FusedLog, number: int | None, profile: Path | None, track: Path | None, console: Console
) -> None:
    from app.drives.outputs.profile import build_profile, table_facts
    from app.drives.outputs.profile_marks import datum_words
    from app.drives.outputs.profile_picture import printable, profile_figure, written
    from app.drives.outputs.track import track_chunks
    from app.map.attribution import attribution
    from app.map.outputs import whole
    from app.map.slope_map import picture_format

    estimated = one.result.track
    if profile is not None:
        slopes = {s.segment: (s.slope_percent, s.slope_sigma_percent) for s in one.result.slopes}
        facts = table_facts(one.network.table, estimated.segment)
        columns = build_profile(estimated, estimated.segment, slopes, facts)
        path = _numbered(profile, number)
        datum, title = datum_words(one.result.report), printable(one.source.short_name)
        figure = profile_figure(columns, title, one.result.measurements, datum=datum)
        with whole(path) as partial:
            partial.write_bytes(written(figure, picture_format(path)))
        console.note(f"{path}: profile of {one.source.short_name}.")
    if track is not None:
        path = _numbered(track, number)
        with path.open("w", encoding="utf-8") as file:
            file.writelines(track_chunks(estimated, estimated.segment, {"attribution": attribution()}))
        console.note(f"{path}: track of {one.source.short_name}.")


def _numbered(path: Path, number: int | None) -> Path:
    return path if number is None else path.with_name(f"{path.stem}-{number}{path.suffix}")
