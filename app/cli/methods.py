"""``versant methods``: what can be chosen by name."""

from __future__ import annotations

import inspect
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from app.cli.console import Console, spoken, tell, write_json
from app.cli.options import JSON_FILE, arg
from app.core.messages import say
from fusion.registry import DEFAULT_METHOD

if TYPE_CHECKING:
    from fusion.methods.base import Method

app = typer.Typer(add_completion=False)


@app.command("methods")
def methods(
    ctx: typer.Context,
    names: list[str] | None = arg("Only these methods.", default=None, metavar="[NAME]..."),
    json_file: Path | None = JSON_FILE,
) -> None:
    """List methods with source, needs and options, then formats, windows, resamplers and the like."""
    from fusion.catalogue import METHODS

    console: Console = ctx.obj
    figures = catalogue()
    for name in names or list(METHODS):
        _show(console, name, METHODS[name])
    if not names:
        for role in ("formats", "windows", "resamplers", "triggers", "positionings", "outputs", "receivers"):
            rows = [[name, text] for name, text in figures[role].items()]
            console.table([role, ""], rows)
            typer.echo()
    write_json(json_file, figures)


def catalogue() -> dict[str, Any]:
    """Every registry's names; methods with source, needs and options."""
    from app.exports.formats import SEGMENT_FORMATS
    from fusion.catalogue import METHODS, POSITIONINGS
    from fusion.filters.resampling import RESAMPLERS
    from fusion.filters.triggers import TRIGGERS
    from fusion.formats import FORMATS
    from fusion.simulate.receiver.readings import RECEIVERS
    from fusion.terrain.windows import WINDOWS

    return {
        "default_method": DEFAULT_METHOD,
        "methods": {
            name: {
                "description": method.description,
                "source": method.source,
                "needs": list(method.needs),
                "options": options(method),
            }
            for name, method in METHODS.items()
        },
        "formats": {
            name: say("methods.format", what=item.description, suffixes=", ".join(item.suffixes))
            for name, item in FORMATS.items()
        },
        "windows": {name: item.description for name, item in WINDOWS.items()},
        "resamplers": {
            name: (inspect.getdoc(item) or "").partition("\n")[0] for name, item in RESAMPLERS.items()
        },
        "triggers": {name: item.description for name, item in TRIGGERS.items()},
        "positionings": {name: item.description for name, item in POSITIONINGS.items()},
        "outputs": {item.suffixes[0]: item.description for item in SEGMENT_FORMATS.values()},
        "receivers": {name: say("methods.receiver", metres=item.h_acc_m) for name, item in RECEIVERS.items()},
    }


def options(method: Method) -> dict[str, dict[str, Any]]:
    """The options of a method: default, what is allowed, and description (which names the unit)."""
    from fusion.options import option_facts

    return {name: asdict(fact) for name, fact in option_facts(method.options_model).items()}


def _show(console: Console, name: str, method: Method) -> None:
    default = "  (default)" if name == DEFAULT_METHOD else ""
    tell("methods.one", name=name, default=default, what=method.description)
    tell("methods.source", source=method.source)
    tell("methods.needs", needs="; ".join(map(spoken, method.needs)))
    rows = [
        [f"  {option}", _plain(o["default"]), o["allowed"], o["description"]]
        for option, o in options(method).items()
    ]
    if rows:
        console.table(["  option", "default", "allowed", "meaning"], rows)
    typer.echo()


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
