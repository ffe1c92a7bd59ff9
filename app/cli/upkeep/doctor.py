"""``versant doctor``."""

# ruff: noqa: PLC0415 - a command imports what it needs when it runs (see app.cli)

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

import typer

from app.cli.console import Console, write_json
from app.cli.options import DataDir, JsonFile

if TYPE_CHECKING:
    from app.upkeep.doctor import Finding

app = typer.Typer(add_completion=False)


@app.command("doctor")
def doctor(ctx: typer.Context, data_dir: DataDir = None, json_file: JsonFile = None) -> None:
    """Look for what is wrong with a service; changes nothing.

    Versions, room, database and schema, clocks, queue, squares, logs, elevation, and who reaches the API; each finding
    with what to do. Exit status 1 where something fails, 0 with warnings.
    """
    from app.cli.database import as_it_is, settings_for
    from app.core.databases import UnreachableError
    from app.upkeep.doctor import Patient, examine

    console: Console = ctx.obj
    chosen, embedded = settings_for(data_dir), True if data_dir else None
    try:
        with as_it_is(chosen, embedded=embedded) as (settings, factory), console.progress() as bars:
            findings = examine(Patient(settings, factory), bars.work("looking"))
    except UnreachableError as error:
        findings = examine(Patient(chosen, None, str(error)))
    console.table(("", "what", "found", "to do"), [_row(one) for one in findings])
    worst = max(findings, key=lambda one: ("ok", "warn", "fail").index(one.state)).state
    write_json(json_file, {"state": worst, "findings": [asdict(one) for one in findings]})
    if worst == "fail":
        failed = ", ".join(one.subject for one in findings if one.state == "fail")
        console.complain(f"Something is wrong: {failed}.")
        raise typer.Exit(1)


def _row(one: Finding) -> tuple[str, str, str, str]:
    return one.state, one.subject, one.found, one.advice
