"""``versant track``: positions only, no roads needed."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.cli.console import Console, part_of, write_json
from app.cli.logs import LogFiles, LogNames, Together, drives_of
from app.cli.options import (
    ColumnsOption,
    GnssName,
    GnssOption,
    JsonFile,
    in_a_folder,
    naming,
    parse_assignments,
    parse_columns,
)
from app.core.text import whole_file
from fusion.errors import FusionError
from fusion.registry import DEFAULT_POSITIONING

if TYPE_CHECKING:
    from app.cli.positions import Positions
    from fusion.types import Progress

app = typer.Typer(add_completion=False)


@app.command("track")
def track(
    ctx: typer.Context,
    logs: LogNames,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Positions: .csv or .geojson.", callback=in_a_folder)
    ],
    gnss: GnssName = DEFAULT_POSITIONING,
    gnss_option: GnssOption = None,
    columns: ColumnsOption = None,
    together: Together = False,
    json_file: JsonFile = None,
) -> None:
    """Write the positions of logs, with their heights and stated accuracies.

    A log that fails is reported, and the others go on.
    """
    from app.cli.positions import TRACK_WRITERS
    from fusion.catalogue import POSITIONINGS
    from fusion.gnss.positioning import options_of

    console: Console = ctx.obj
    if out.suffix.lower() not in TRACK_WRITERS:
        raise typer.BadParameter(
            f"No track is written to files ending in {out.suffix!r}. Choose .csv or .geojson.",
            param_hint="'--out'",
        )
    named = parse_columns(columns)
    chosen = parse_assignments(gnss_option, "--gnss-option")
    with naming("--gnss"):
        positioning = POSITIONINGS[gnss]
    with naming("--gnss-option"):
        options_of(positioning, chosen)
    tracks: list[Positions] = []
    outcomes = []
    with console.progress() as bars:
        drives = drives_of(logs, together)
        for source in drives:
            reason = None
            try:
                tracks.append(_read(source, named, gnss, chosen, bars.work(source.short_name)))
                console.warn(source.name, tracks[-1].warnings)
            except (FusionError, OSError) as error:
                reason = console.complain_of(source.name, error)
            found = None if reason else tracks[-1]
            outcomes.append(
                {
                    "file": source.name,
                    "positions": len(found.fix) if found else 0,
                    "reason": reason,
                    "gnss": found.report if found else {},
                    "warnings": list(found.warnings) if found else [],
                }
            )
    if tracks:
        with whole_file(out) as partial:
            TRACK_WRITERS[out.suffix.lower()](tracks, partial)
        typer.echo(
            f"{out}: {sum(len(t.fix) for t in tracks)} positions from {len(tracks)} of {len(drives)} logs."
        )
    write_json(json_file, {"gnss": gnss, "logs": outcomes})
    if len(tracks) < len(drives):
        raise typer.Exit(1)


def _read(
    source: LogFiles, columns: Mapping[str, str], gnss: str, options: Mapping[str, Any], progress: Progress
) -> Positions:
    from app.cli.positions import Positions
    from fusion.gnss.positioning import positioned

    read = source.read(part_of(progress, 0.0, 0.3), columns)
    found = positioned(read, gnss, options, part_of(progress, 0.3, 1.0))
    log, solved = found.log, found.solved_epochs()
    return Positions(
        source.short_name, log.fix, log.outages_s, log.geoid, found.report, solved, warnings=log.warnings
    )
