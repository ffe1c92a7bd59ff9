"""``versant export``: the map as one file, or as a picture."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.console import Console, write_json
from app.cli.options import DataDir, JsonFile, MapFile, MapScale, in_a_folder, naming, parse_box, usable_map

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

    from app.core.db import Bounds
    from app.map.segment import Segment
    from fusion.types import Progress

EACH = 5000
"""Segments after which progress is told."""

app = typer.Typer(add_completion=False)


@app.command("export")
def export(
    ctx: typer.Context,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="File: .geojson, .parquet, .gpkg or .csv.", callback=in_a_folder),
    ] = None,
    bbox: Annotated[
        str | None, typer.Option(metavar="W,S,E,N", help="Only segments that meet this box, degrees.")
    ] = None,
    driven: Annotated[bool, typer.Option("--driven", help="Only segments that were driven.")] = False,
    gaps: Annotated[
        bool, typer.Option("--gaps", help="Give undriven segments between driven ones a slope as well.")
    ] = False,
    map_file: MapFile = None,
    scale: MapScale = None,
    data_dir: DataDir = None,
    json_file: JsonFile = None,
) -> None:
    """Write every segment with its slope, as it stands at one moment, to a file, or draw a map of them.

    A map shows the box, or all that was driven; beyond 50,000 segments it leaves undriven roads out.
    """
    from app.cli.database import sessions
    from app.map.attribution import attribution
    from app.map.outputs import write
    from app.terrain import store as dem
    from app.terrain.coverage import rasters_over

    console: Console = ctx.obj
    box = parse_box(bbox)
    _usable(out, map_file, scale)
    figures: dict[str, Any] = {}
    with sessions(data_dir) as (settings, factory), factory() as session, console.progress() as bars:
        # One snapshot, so that a drive that ends meanwhile is in it altogether or not at all.
        session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        terrain = dem.current_dem(session, settings.dem_dir)
        source = attribution(rasters_over(session, terrain, bbox=box, driven=driven))
        if out is not None:
            features = _features(session, box, driven, gaps, bars.work(out.name))
            figures |= {"file": str(out), "segments": write(features, out, source=source)}
        if map_file is not None:
            from app.map.map_file import map_of_store

            drawn, notes = map_of_store(
                session, map_file, box, driven=driven, gaps=gaps, source=source, scale=scale
            )
            figures |= {"map": str(map_file), "segments_drawn": drawn}
            for note in notes:
                console.note(f"{map_file}: {note}")
    if out is not None:
        typer.echo(f"{out}: {figures['segments']} segments.")
    if map_file is not None:
        typer.echo(f"{map_file}: map of {figures['segments_drawn']} segments.")
    write_json(json_file, figures)


def _usable(out: Path | None, map_file: Path | None, scale: float | None) -> None:
    """Refuse, before any work, names that say nothing of what to write."""
    from app.map.outputs import output_for

    if out is None and map_file is None:
        raise typer.BadParameter(
            "nothing is asked for: name a file by -o, or a map by --map.", param_hint="-o"
        )
    usable_map(map_file, scale)
    if out is not None:
        with naming("--out"):
            output_for(out)


def _features(
    session: Session, box: Bounds | None, driven: bool, gaps: bool, progress: Progress
) -> Iterator[Segment]:
    from app.map.pages import all_segments
    from app.map.store import count_segments

    total = max(count_segments(session, bbox=box, driven=True if driven else None), 1)
    for done, segment in enumerate(all_segments(session, box, driven=driven, gaps=gaps), 1):
        yield segment
        if not done % EACH:
            progress("writing", done / total)
