"""``versant simulate``: a synthetic town with known slopes, and drives through it."""

from __future__ import annotations

from pathlib import Path

import typer

from app.cli.console import Console, write_json
from app.cli.options import JSON_FILE, naming, opt

app = typer.Typer(add_completion=False)


@app.command("simulate")
def simulate(
    ctx: typer.Context,
    out: Path = opt("Folder, made if it is missing.", "-o", "--out", default=..., metavar="DIR"),
    seed: int = opt("The same seed makes the same files.", default=1, min=0),
    drives: int = opt("Number of drives.", default=6, min=0),
    receiver: str | None = opt("m8, phone or f9p, as CSV; without it a mix, as CSV and UBX."),
    duration_s: float = opt("Length of a drive, seconds.", "--duration", default=600.0, min=10),
    rate_hz: float = opt("Epochs per second.", "--rate", default=1.0, min=0.1, max=100),
    json_file: Path | None = JSON_FILE,
) -> None:
    """Make a hilly town (town.osm, dem.tif), drives through it, and their true slopes (truth.csv)."""
    from fusion.simulate.demonstration import write_all
    from fusion.simulate.receiver.readings import RECEIVERS

    console: Console = ctx.obj
    if receiver is not None:
        with naming("--receiver"):
            RECEIVERS[receiver]
    with console.progress() as bars:
        bundle = write_all(
            out,
            drives,
            seed,
            duration_s=duration_s,
            rate_hz=rate_hz,
            receiver=receiver,
            progress=bars.work("simulating"),
        )
    for path in (bundle.osm, bundle.dem, *bundle.drives, bundle.truth):
        typer.echo(str(path))
    paths = [str(path) for path in bundle.drives]
    write_json(json_file, {"seed": seed, "segments": len(bundle.town.roads), "drives": paths})
