"""``versant elevation``: the elevation rasters that are in use, which of them counts where, and their removal."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from app.cli.console import Console, spoken, tell, write_json
from app.cli.database import sessions
from app.cli.options import DATA_DIR, JSON_FILE, arg, flag
from app.core.messages import say
from fusion.errors import TerrainError
from fusion.messages import message_of

if TYPE_CHECKING:
    from app.core.settings.places import FilePlace
    from app.terrain.coverage import Effect
    from app.terrain.store import DemSource

elevation = typer.Typer(
    no_args_is_help=True, help="List, rank or remove the elevation rasters that are in use."
)
app = typer.Typer(add_completion=False)
app.add_typer(elevation, name="elevation")

_MIB = 2**20


@elevation.command("list")
def list_rasters(
    ctx: typer.Context, data_dir: Path | None = DATA_DIR, json_file: Path | None = JSON_FILE
) -> None:
    """List the rasters: place, resolution, datum, priority, size, and how many segments lie under each.

    Where several lie over each other the one of the highest priority counts, of one priority the finest.
    """
    from app.terrain.coverage import segments_under
    from app.terrain.files import add_bounds
    from app.terrain.store import current_dem

    console: Console = ctx.obj
    with sessions(data_dir) as (settings, factory):
        add_bounds(factory, settings.dem_dir)
        with factory() as session:
            active = current_dem(session, settings.dem_dir)
            sources = active.sources if active else ()
            counts = segments_under(session, sources)
        rows = [
            _facts(source, settings.dem_dir) | {"segments": n}
            for source, n in zip(sources, counts, strict=True)
        ]
    rows.sort(key=lambda row: -row["priority"])
    columns = ("name", "priority", "posting m", "datum", "west, south, east, north", "MiB", "segments")
    console.table(columns, [[*map(row.get, ("name", "priority", "posting_m", "datum")), _box(row["bounds_deg"]),
                             row["mib"], row["segments"]] for row in rows])  # fmt: skip
    for row in rows:
        if row["problem"]:
            console.complain(row["problem"])
    write_json(json_file, {"rasters": rows})


@elevation.command("priority", context_settings={"ignore_unknown_options": True})
def priority(
    ctx: typer.Context,
    name: str = arg("A raster, as `list` names it."),
    number: int = arg("The higher the sooner it counts; any whole number.", metavar="N"),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Say how early a raster counts where others lie over it, and renew the heights of the segments under it."""
    from app.terrain.imports import rank_dem

    console: Console = ctx.obj
    with sessions(data_dir) as (settings, factory), console.progress() as bars:
        active = rank_dem(factory, name, number, settings.dem_dir, bars.work(name))
    tell("elevation.priority", name=name, number=number, advice=_ADVICE)
    ranks = {source.name: source.priority for source in active.sources} if active else {}
    write_json(json_file, {"priorities": ranks})


@elevation.command("remove")
def remove(
    ctx: typer.Context,
    names: list[str] = arg("Rasters, as `list` names them.", metavar="NAME..."),
    dry_run: bool = flag("Say what would change, and change nothing.", "--dry-run"),
    yes: bool = flag("Do not ask, whatever it changes.", "--yes"),
    data_dir: Path | None = DATA_DIR,
    json_file: Path | None = JSON_FILE,
) -> None:
    """Take rasters out of use; what is left gives the heights of the segments that they covered.

    Where measured segments are left without any raster it asks first. The files stay for VERSANT_ORPHAN_DAYS, for
    drives that run and backups that may be restored; then a worker or `versant sweep` removes them, unless another
    database may use them (`versant sweep --only-database`). To undo it, import the file again.
    """
    from app.terrain.coverage import effect_of_removal
    from app.terrain.files import add_bounds
    from app.terrain.imports import remove_dem
    from app.terrain.store import chosen, current_dem

    console: Console = ctx.obj
    with sessions(data_dir) as (settings, factory):
        add_bounds(factory, settings.dem_dir)
        with factory() as session:
            active = current_dem(session, settings.dem_dir)
            former = active.sources if active else ()
            gone = chosen(former, names)
            remaining = [source for source in former if source not in gone]
            effect = effect_of_removal(session, gone, remaining)
        typer.echo(spoken(_describe_effect(gone, remaining, effect)))
        if not dry_run:
            _confirm(effect, yes)
            with console.progress() as bars:
                remove_dem(factory, names, settings.dem_dir, bars.work("elevation"))
            tell("elevation.removed", names=", ".join(source.name for source in gone), advice=_ADVICE)
    figures = {"removed": [s.name for s in gone], "left": [s.name for s in remaining], "dry_run": dry_run}
    write_json(json_file, figures | asdict(effect))


_ADVICE = say("elevation.advice")


def _describe_effect(gone: Sequence[DemSource], remaining: Sequence[DemSource], effect: Effect) -> str:
    names = ", ".join(source.name for source in gone)
    return say(
        "elevation.under",
        names=names,
        segments=effect.segments,
        measured=effect.measured,
        drives=effect.drives,
        bare=effect.bare,
        left=len(remaining),
    )


def _confirm(effect: Effect, yes: bool) -> None:
    if yes or not effect.bare:
        return
    if not sys.stdin.isatty():
        raise TerrainError(say("elevation.nothing_removed", n=effect.bare))
    typer.confirm(spoken(say("elevation.remove_ask")), abort=True)


def _facts(source: DemSource, dem_dir: FilePlace) -> dict[str, Any]:
    """What ``list`` shows of a raster; ``problem`` says why where its file cannot be read."""
    from app.terrain.store import local_raster
    from fusion.terrain.dem import Dem

    facts: dict[str, Any] = {
        "name": source.name,
        "priority": source.priority,
        "bounds_deg": source.bounds_deg,
        "source": source.source,
        "licence": source.licence,
    }
    facts |= dict.fromkeys(("posting_m", "datum", "mib", "problem"))
    try:
        path = local_raster(dem_dir, source)
        with Dem.open([path]) as dem:
            facts |= {"posting_m": max(dem.postings_m[0]), "datum": dem.datum}
            facts["mib"] = path.stat().st_size / _MIB
    except TerrainError as error:
        facts["problem"] = message_of(error)
    return facts


def _box(bounds_deg: Sequence[float] | None) -> str | None:
    return None if bounds_deg is None else ", ".join(f"{corner:.5g}" for corner in bounds_deg)
