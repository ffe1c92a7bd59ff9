"""``versant export``: the map as one file, or as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import app.cli.options as cli
from app.cli.console import Console, spoken, write_json
from app.cli.database import sessions
from app.core.messages import say

if TYPE_CHECKING:
    from app.exports.making import Request

app = typer.Typer(add_completion=False)


@app.command("export")
def export(
    ctx: typer.Context,
    out: Path | None = cli.written_file(
        "-o",
        "--out",
        help="File; its suffix chooses the format, such as .geojson, .parquet, .gpkg, .fgb, .csv or .pmtiles.",
    ),
    form: str | None = cli.opt(
        "The format by its name, where the suffix does not tell it: see docs/reference/export-formats.md.",
        "--as",
        metavar="FORMAT",
    ),
    option: list[str] | None = cli.opt(
        "Option of the format; may be given several times.", "--option", metavar="NAME=VALUE"
    ),
    bbox: str | None = cli.opt("Only segments that meet this box, degrees.", metavar="W,S,E,N"),
    region: str | None = cli.opt("Only roads of this region (`versant regions list`).", metavar="NAME"),
    driven: bool = cli.flag("Only segments that were driven.", "--driven"),
    gaps: bool = cli.GAPS,
    map_file: Path | None = cli.MAP_FILE,
    scale: float | None = cli.MAP_SCALE,
    data_dir: Path | None = cli.DATA_DIR,
    json_file: Path | None = cli.JSON_FILE,
) -> None:
    """Write every segment with its slope, as it stands at one moment, to a file, or draw a map of them.

    Other formats hold whole ways, vector tiles, or what a routing program reads; each says where its data come from. A
    map shows the box, or all that was driven; beyond 50,000 segments it leaves undriven roads out.
    """
    from app.core.db import snapshot
    from app.core.text import whole_file
    from app.exports.formats import write_companions
    from app.exports.making import make_file
    from app.map.segment import attribution
    from app.terrain.coverage import sources_over
    from app.terrain.store import current_dem

    console: Console = ctx.obj
    box = cli.parse_box(bbox)
    filters = {"bbox": box, "region": region, "driven": driven, "gaps": gaps}
    request = _request_for(out, form, option, filters)
    if request is None and map_file is None:
        raise typer.BadParameter(spoken(say("export.nothing_asked")), param_hint="-o")
    cli.usable_map(map_file, scale)
    figures, sentences = dict[str, Any](), list[str]()
    with (
        sessions(data_dir) as (settings, factory),
        snapshot(factory) as session,
        console.progress() as bars,
    ):
        if request is not None and out is not None:
            progress = bars.work(out.name)
            with whole_file(out) as partial:
                written = make_file(
                    session, settings, request, partial, lambda share: progress("writing", share)
                )
            write_companions(request.format.companions(out, written.stated))
            figures |= {"file": str(out), "format": request.format.name, request.format.holds: written.count}
            figures |= {"data_version": written.state.version, "notes": list(written.notes)}
            for note in written.notes:
                console.note(say("cli.of_file", file=out, note=note))
            sentences.append(say("export.written", file=out, n=written.count, what=request.format.holds))
        if map_file is not None:
            from app.map.picture.files import map_of_store

            terrain = current_dem(session, settings.dem_dir)
            under = sources_over(session, terrain, bbox=box, driven=driven)
            source = attribution(one.credit for one in under)
            drawn, notes = map_of_store(
                session, map_file, box, driven=driven, gaps=gaps, source=source, scale=scale
            )
            figures |= {"map": str(map_file), "segments_drawn": drawn}
            for note in notes:
                console.note(say("cli.of_file", file=map_file, note=note))
            sentences.append(say("export.map", file=map_file, n=drawn))
    for sentence in sentences:
        typer.echo(spoken(sentence))
    write_json(json_file, figures)


def _request_for(
    out: Path | None, form: str | None, option: list[str] | None, filters: dict[str, Any]
) -> Request | None:
    """What is to be written; names and options that do not exist are wrong usage, before any work."""
    from app.exports.formats import format_for
    from app.exports.making import request_of

    if out is None:
        if form is not None or option:
            raise typer.BadParameter(spoken(say("export.format_of")), param_hint="--as")
        return None
    with cli.naming("--as" if form is not None else "--out"):
        output_format = format_for(out, form)
    with cli.naming("--option"):
        options = cli.parse_assignments(option, "--option")
        return request_of(output_format.name, options, **filters, local=True)
