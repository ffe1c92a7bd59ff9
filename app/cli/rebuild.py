"""``versant rebuild``: the network's slopes from all stored passes."""

from __future__ import annotations

import time

import typer

from app.cli.console import Console, write_json
from app.cli.database import sessions
from app.cli.options import DataDir, JsonFile
from app.network.rebuild import rebuild_network

app = typer.Typer(add_completion=False)


@app.command("rebuild")
def rebuild(ctx: typer.Context, data_dir: DataDir = None, json_file: JsonFile = None) -> None:
    """Compute the slopes of the whole network anew from what the drives contributed.

    Wanted after an elevation import, which by itself changes no slope, and after an update of Versant that
    changes how drives are put together. Drives are not processed again, and may come and go meanwhile.
    """
    console: Console = ctx.obj
    started = time.perf_counter()
    with sessions(data_dir) as (_, factory), console.progress() as bars:
        segments = rebuild_network(factory, bars.work("network"))
    seconds = time.perf_counter() - started
    typer.echo(f"{segments} segments of the network in {seconds:.1f} s.")
    write_json(json_file, {"segments": segments, "seconds": round(seconds, 3)})
