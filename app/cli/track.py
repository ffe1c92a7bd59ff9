"""``versant track``: positions only, no roads needed."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.console import Console, write_json
from app.cli.options import JsonFile, in_a_folder
from fusion.errors import FusionError, UnknownNameError
from fusion.registry import DEFAULT_POSITIONING

if TYPE_CHECKING:
    from app.cli.positions import Positions
    from fusion.gnss import Positioning
    from fusion.types import Progress

app = typer.Typer(add_completion=False)


@app.command("track")
def track(
    ctx: typer.Context,
    logs: Annotated[list[Path], typer.Argument(metavar="LOG...", help="Drive logs.")],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Positions: .csv or .geojson.", callback=in_a_folder)
    ],
    gnss: Annotated[
        str,
        typer.Option(metavar="NAME", help="How positions are computed; `versant methods` lists the ways."),
    ] = DEFAULT_POSITIONING,
    json_file: JsonFile = None,
) -> None:
    """Write the positions of logs, with their heights and stated accuracies.

    A log that fails is reported, and the others go on.
    """
    from app.cli.positions import TRACK_WRITERS
    from fusion.gnss import POSITIONINGS

    console: Console = ctx.obj
    if out.suffix.lower() not in TRACK_WRITERS:
        raise typer.BadParameter(
            f"No track is written to files ending in {out.suffix!r}. Choose .csv or .geojson."
        )
    try:
        positioning = POSITIONINGS[gnss]
    except UnknownNameError as error:
        raise typer.BadParameter(str(error)) from error
    tracks: list[Positions] = []
    outcomes = []
    with console.progress() as bars:
        for path in logs:
            reason = None
            try:
                tracks.append(_read(path, positioning, bars.work(path.name)))
            except (FusionError, OSError) as error:
                reason = console.complain_of(path, error)
            found = 0 if reason else len(tracks[-1].fix)
            outcomes.append({"file": str(path), "positions": found, "reason": reason})
    if tracks:
        TRACK_WRITERS[out.suffix.lower()](tracks, out)
        typer.echo(
            f"{out}: {sum(len(t.fix) for t in tracks)} positions from {len(tracks)} of {len(logs)} logs."
        )
    write_json(json_file, {"gnss": gnss, "logs": outcomes})
    if len(tracks) < len(logs):
        raise typer.Exit(1)


def _read(path: Path, positioning: Positioning, progress: Progress) -> Positions:
    from app.cli.positions import Positions
    from fusion.formats import read_log

    log = read_log(path, progress=progress)
    return Positions(path.name, positioning.positions(log, progress), log.gaps_s, log.geoid)
