"""``versant export``: the map as one file."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.console import Console, write_json
from app.cli.options import DataDir, JsonFile, in_a_folder, parse_box
from fusion.errors import UnknownNameError

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

    from app.core.db import Bounds
    from app.map.segment import Segment
    from fusion.types import Progress

PAGE = 5000
"""Segments that are read from the database at once."""

app = typer.Typer(add_completion=False)


@app.command("export")
def export(
    ctx: typer.Context,
    out: Annotated[
        Path,
        typer.Option("-o", "--out", help="File: .geojson, .parquet, .gpkg or .csv.", callback=in_a_folder),
    ],
    bbox: Annotated[
        str | None, typer.Option(metavar="W,S,E,N", help="Only segments that meet this box, degrees.")
    ] = None,
    driven: Annotated[bool, typer.Option("--driven", help="Only segments that were driven.")] = False,
    gaps: Annotated[
        bool, typer.Option("--gaps", help="Give undriven segments between driven ones a slope as well.")
    ] = False,
    data_dir: DataDir = None,
    json_file: JsonFile = None,
) -> None:
    """Write every segment with its slope, as it stands at one moment, to a file."""
    from app.cli.database import sessions
    from app.map.attribution import attribution
    from app.map.outputs import output_for, write
    from app.terrain import store as dem
    from app.terrain.coverage import rasters_over

    console: Console = ctx.obj
    box = parse_box(bbox)
    try:
        output_for(out)
    except UnknownNameError as error:
        raise typer.BadParameter(str(error)) from error
    with sessions(data_dir) as (settings, factory), factory() as session, console.progress() as bars:
        # One snapshot, so that a drive that ends meanwhile is in it altogether or not at all.
        session.connection(execution_options={"isolation_level": "REPEATABLE READ"})
        terrain = dem.current_dem(session, settings.dem_dir)
        source = attribution(rasters_over(session, terrain, bbox=box, driven=driven))
        features = _features(session, box, driven, gaps, bars.work(out.name))
        count = write(features, out, source=source)
    typer.echo(f"{out}: {count} segments.")
    write_json(json_file, {"file": str(out), "segments": count})


def _features(
    session: Session, box: Bounds | None, driven: bool, gaps: bool, progress: Progress
) -> Iterator[Segment]:
    from app.map import store as segments

    wanted = True if driven else None
    total = max(segments.count_segments(session, bbox=box, driven=wanted), 1)
    after, done = 0, 0
    while rows := segments.segment_items(
        session, bbox=box, after_id=after, limit=PAGE, driven=wanted, gaps=gaps
    ):
        yield from rows
        after, done = rows[-1].stored_id, done + len(rows)
        progress("writing", done / total)
