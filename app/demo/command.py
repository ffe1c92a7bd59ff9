"""``versant demo``: the whole job on data that it makes itself."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.cli.console import Console, tell, write_json
from app.cli.options import JSON_FILE, flag, opt
from app.core.messages import say

if TYPE_CHECKING:
    from app.demo.run import DemoResult
    from app.demo.score import Score

EXAMPLES = 24
"""Rows of the table of single segments."""

LABELS = {
    "service": "Versant",
    "raw": "raw altitudes",
    "dem": "DEM alone",
    "straight": "straight line",
}

app = typer.Typer(add_completion=False)


@app.command("demo")
def demo(
    ctx: typer.Context,
    serve: bool = flag("Keep serving the result until Ctrl-C.", "--serve"),
    output: Path = opt("Where the results go.", "--output", "-o", default=Path("demo"), metavar="DIR"),
    port: int = opt("TCP port; 0 for any free one.", default=0, min=0, max=65535),
    json_file: Path | None = JSON_FILE,
) -> None:
    """Simulate a town and drives, run them through a service of its own, and compare with the truth.

    Needs PostgreSQL with PostGIS installed and nothing else; no database is touched but its own.
    """
    from app.cli.children import stop_signals
    from app.cli.keys.commands import login_address
    from app.cli.keys.starting import first_link
    from app.demo.files import figures, map_page, write_files
    from app.demo.run import demo_service, run_demo

    console: Console = ctx.obj
    started = time.perf_counter()
    with stop_signals():
        console.note(say("demo.starting"))
        with demo_service(console, port) as service:
            console.note(say("demo.serving", address=service.address))
            with console.progress() as bars:
                result = run_demo(service, output / "input", bars)
            files = write_files(result, output)
            show_scores(console, result)
            tell("demo.done", seconds=time.perf_counter() - started)
            for what, path in files.items():
                tell("demo.file", path=path, what=what)
            write_json(json_file, figures(result))
            if not serve:
                program = (
                    sys.argv[0] if Path(sys.argv[0]).name == "versant" else "versant"
                )  # as it was called
                tell("demo.on_a_map", program=program)
                return
            tell("demo.still", address=service.address)
            page, token = map_page(result.features), first_link(service.settings)
            opened = login_address(service.address, token, page) if token else service.address + page
            tell("demo.open", address=opened)
            service.serve_forever()
        return
    if not serve:  # interrupted before the end
        raise typer.Exit(130)


def show_scores(console: Console, result: DemoResult) -> None:
    """Print the slopes beside the truth: single segments, all of them, structures, classes of road."""
    from app.demo.score import examples

    estimates, features = result.estimates, result.properties
    rows = []
    for key in examples(result.truth, EXAMPLES):
        road, p = result.truth[key], features[key]
        kind = road.highway + (", bridge" if road.bridge else "") + (", tunnel" if road.tunnel else "")
        slope = p["slope_percent"]
        error = None if key not in estimates else slope - road.slope_percent
        rows.append(
            [kind, p["length_m"], road.slope_percent, slope, p["slope_sigma_percent"], error, p["drives"]]
        )
    console.table(
        ["road", "length m", "true %", "measured %", "sigma %", "error %", "drives"],
        rows,
        title=say("demo.some", n=len(rows), all=len(result.truth)),
    )
    typer.echo()
    _scores(console, "All driven segments", {LABELS[n]: s for n, s in result.scores().items()})
    typer.echo()
    _structures(console, result.scores_by_structure())
    typer.echo()
    _scores(console, "Versant by class of road", result.scores_by_kind())


def _structures(console: Console, scores: dict[str, dict[str, Score]]) -> None:
    rows = [
        [kind, of["service"].segments, *(_with_coverage(of[name]) for name in LABELS)]
        for kind, of in scores.items()
    ]
    title = "Bridges and tunnels beside the open road: RMSE % (coverage)"
    console.table(["", "segments", *LABELS.values()], rows, title=title)
    tell("demo.straight")


def _with_coverage(one: Score) -> str:
    return f"{one.rmse_percent:.2f} ({100 * one.coverage:.0f} %)" if one.estimated else "–"


def _scores(console: Console, title: str, scores: dict[str, Score]) -> None:
    rows = [
        [
            name,
            s.segments,
            f"{100 * s.coverage:.0f} %",
            s.rmse_percent,
            s.p90_percent,
            _share(s.within_95),
            _share(s.wrong_sign),
        ]
        for name, s in scores.items()
    ]
    columns = ["", "segments", "coverage", "RMSE %", "p90 %", "within 1.96 sigma", "wrong sign"]
    console.table(columns, rows, title=title)


def _share(value: float) -> str:
    return "–" if value != value else f"{100 * value:.0f} %"  # noqa: PLR0124 - NaN
