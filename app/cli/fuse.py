"""``versant fuse``: slopes from files, without a server and without a database."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import app.cli.options as cli
from app.cli.console import Bars, Console, spoken, write_json
from app.cli.logs.named import LogFiles, base_of, sorted_drives
from app.core.messages import say
from app.core.text import whole_file
from fusion.errors import FusionError
from fusion.registry import DEFAULT_METHOD, DEFAULT_POSITIONING

if TYPE_CHECKING:
    from app.cli.logs.fusing import FusedLog, Fusion
    from app.map.segment import Segment
    from fusion.results import Solution

app = typer.Typer(add_completion=False)

LONGEST_NAME = 60
"""Characters of a log's name in the names of its pictures."""
RASTER_SUFFIXES = (".hgt", ".tif", ".tiff", ".vrt")


@app.command("fuse")
def fuse(
    ctx: typer.Context,
    logs: list[Path] = cli.LOG_NAMES,
    roads: Path = cli.ROADS,
    dem: list[Path] | None = cli.opt(
        "Elevation rasters (GeoTIFF, HGT ...); may be given several times. The quality layer of X_dem.tif, "
        "X_num.tif, is found beside it.",
        metavar="FILE...",
    ),
    method: str = cli.opt("Estimator; `versant methods` lists them.", default=DEFAULT_METHOD),
    option: list[str] | None = cli.METHOD_OPTION,
    gnss: str = cli.gnss_name(DEFAULT_POSITIONING),
    gnss_option: list[str] | None = cli.GNSS_OPTION,
    base: list[Path] | None = cli.BASE,
    base_place: str | None = cli.BASE_PLACE,
    columns: list[str] | None = cli.COLUMNS_OPTION,
    together: bool = cli.TOGETHER,
    apart: bool = cli.APART,
    control: Path | None = cli.CONTROL,
    gaps: bool = cli.GAPS,
    out: Path | None = cli.written_file(
        "-o", "--out", help="Segments: .geojson, .parquet, .gpkg or .csv; without it GeoJSON on stdout."
    ),
    profile: Path | None = cli.written_file(
        "--profile",
        help="Elevation profile: .png, .pdf or .svg; one per log, with its number and name if several.",
        metavar="OUT.png",
    ),
    track: Path | None = cli.written_file(
        "--track",
        help="Estimated track; one per log, with its number and name if several.",
        metavar="OUT.geojson",
    ),
    map_file: Path | None = cli.MAP_FILE,
    scale: float | None = cli.MAP_SCALE,
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Fuse logs with roads and terrain into segment slopes, without a server or a database.

    Gives the service's numbers for the same logs. A log that fails is reported, and the others go on.
    """
    from app.cli.logs.fusing import Fusion
    from app.core.text import collection_chunks
    from app.exports.format import statements
    from app.exports.formats import segment_format_for, write_segments
    from app.map.segment import attribution
    from fusion.network.control import read_control
    from fusion.roads.osm import read_roads
    from fusion.terrain.dem import Dem

    console: Console = ctx.obj
    named = cli.parse_columns(columns) if columns else {}
    if out is not None:
        with cli.naming("--out"):
            segment_format_for(out)
    chosen = cli.usable_options(method, named, option, gnss, gnss_option)
    cli.usable_map(map_file, scale)
    cli.usable_picture(profile, "--profile")
    logs, dem = _apart(logs, dem or [])
    with ExitStack() as stack:
        points = read_control(control) if control else []
        bars = stack.enter_context(console.progress())
        terrain = stack.enter_context(Dem.open(dem, trusted=True)) if dem else None
        table = read_roads(roads, bars.work(roads.name))
        fusion = Fusion(method, chosen, table, terrain, points)
        station = base_of(base, base_place)
        drives = sorted_drives(logs, console, together=together, apart=apart, columns=named, base=station)
        outcomes = [_one(fusion, source, console, bars) for source in drives]
        combined = fusion.solve(gaps=gaps)
        source = attribution(combined.rasters)
    features, solution = combined.features, combined.solution
    datum = solution.height_datum
    _tell(solution, outcomes, console)
    if fusion.fused and out is None:
        sys.stdout.writelines(
            collection_chunks((one.geojson() for one in features), statements(source, datum))
        )
    elif fusion.fused and out is not None:
        write_segments(features, out, source=source, height_datum=datum)
        console.note(say("fuse.written", file=out, n=len(features), logs=len(fusion.fused), all=len(drives)))
    if fusion.fused and map_file is not None:
        _map(fusion, features, map_file, source, scale)
        console.note(say("fuse.map", file=map_file))
    for number, one in enumerate(fusion.fused, 1):
        _pictures(one, number if len(fusion.fused) > 1 else None, profile, track, console)
    figures = {"method": method, "segments": len(features), "height_datum": datum}
    write_json(json_file, figures | {"remarks": solution.remarks, "logs": outcomes})
    if any(outcome["status"] == "failed" for outcome in outcomes):
        raise typer.Exit(1)


def _apart(logs: list[Path], dem: list[Path]) -> tuple[list[Path], list[Path]]:
    """Logs and rasters: of ``--dem A B`` the parser takes A, and B, which no log is called like, is one too."""
    more = [path for path in logs if dem and path.name.lower().removesuffix(".gz").endswith(RASTER_SUFFIXES)]
    rest = [path for path in logs if path not in more]
    if not rest:
        raise typer.BadParameter(spoken(say("fuse.no_log")), param_hint="LOG...")
    return rest, dem + more


def _one(fusion: Fusion, source: LogFiles, console: Console, bars: Bars) -> dict[str, Any]:
    from app.cli.logs.fusing import outcome_of

    try:
        earlier = fusion.earlier_copy(source)
        if earlier is not None:
            console.note(say("fuse.repeated", name=source.name, earlier=earlier))
            return _without_result(source, "repeated", say("fuse.same", earlier=earlier))
        return outcome_of(fusion.add(source, bars.work(source.short_name)))
    except (FusionError, OSError) as error:
        if console.debug:
            raise
        reason = console.complain_of(source.name, error)
        return _without_result(source, "failed", reason)


def _without_result(source: LogFiles, status: str, reason: str) -> dict[str, Any]:
    return {"file": source.name, "status": status, "reason": reason, "segments": 0}


def _tell(together: Solution, outcomes: list[dict[str, Any]], console: Console) -> None:
    """Say of each log what came of it and what a person should know, and put the same into its outcome."""
    from app.cli.logs.fusing import agreement
    from app.drives.outputs.summary import summary

    done = [outcome for outcome in outcomes if outcome["status"] == "done"]
    agreement(together, done)
    for outcome in done:
        outcome["summary"] = summary(outcome["file"], outcome["report"])
        console.note(outcome["summary"])
        console.warn(outcome["file"], outcome["report"]["warnings"])
    console.warn("", together.remarks)


def _map(fusion: Fusion, features: Sequence[Segment], path: Path, source: str, scale: float | None) -> None:
    from app.map.picture.files import map_of_segments

    count = len(fusion.fused)
    title = spoken(say("fuse.title", n=count, name=fusion.fused[0].source.short_name))
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
    from app.map.picture.slope_map import picture_format
    from app.map.segment import attribution

    estimated = one.result.track
    if profile is not None:
        slopes = {s.segment: (s.slope_percent, s.slope_sigma_percent) for s in one.result.slopes}
        facts = table_facts(one.network.table, estimated.segment)
        columns = build_profile(estimated, estimated.segment, slopes, facts)
        path = _numbered(profile, number, one.source)
        datum, title = datum_words(one.result.report), printable(one.source.short_name)
        figure = profile_figure(columns, title, one.result.measurements, datum=datum)
        with whole_file(path) as partial:
            partial.write_bytes(written(figure, picture_format(path)))
        console.note(say("fuse.profile", file=path, name=one.source.short_name))
    if track is not None:
        path = _numbered(track, number, one.source)
        with whole_file(path) as partial, partial.open("w", encoding="utf-8") as file:
            file.writelines(track_chunks(estimated, estimated.segment, {"attribution": attribution()}))
        console.note(say("fuse.track", file=path, name=one.source.short_name))


def _numbered(path: Path, number: int | None, source: LogFiles) -> Path:
    """The file of one log among several: ``profile.png`` becomes ``profile-2-tuesday.png``."""
    if number is None:
        return path
    log = Path((source.members or source.paths)[0].name.removesuffix(".gz")).stem
    name = re.sub(r"[^\w.-]+", "_", log)[:LONGEST_NAME]
    return path.with_name(f"{path.stem}-{number}-{name}{path.suffix}")
