"""The documents say what the code does: their tables are made from the code.

``make tables`` renews them.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import pytest
import typer

from app.cli import COMMANDS
from app.cli import app as cli
from app.core.settings import ENV_PREFIX, Settings
from app.core.telemetry.measures import MEASURES
from app.exports.formats import FORMATS as EXPORTS
from app.main import create_app
from app.map.items.collections import SEGMENTS, WAYS, Collection
from app.ops.metrics import GAUGES, LABELS, Gauges, Metrics
from document_pages import PAGES, TABLE
from fusion.catalogue import METHODS, POSITIONINGS, SOLVERS
from fusion.filters.resampling import RESAMPLERS
from fusion.filters.triggers import TRIGGERS
from fusion.formats import FORMATS
from fusion.methods.base import Options
from fusion.options import option_facts
from fusion.registry import DEFAULT_METHOD
from fusion.terrain.windows import WINDOWS

EXPERIMENTS = {"calais", "lahrech", "saadaoui", "methods_on_roads"}
"""Tables that ``benchmarks/seeds.py --write`` renews."""


def table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    cells = [[str(cell).replace("|", "\\|").replace("\n", " ") for cell in line] for line in lines]
    return "".join(f"| {' | '.join(line)} |\n" for line in cells)


def code(text: object) -> str:
    """Inline code."""
    return f"`{text}`"


def plain(value: Any) -> str:
    """A default value, as one would write it."""
    if isinstance(value, bool):
        return code(str(value).lower())
    if value is None:
        return ""
    return code(f"{value:.4g}" if isinstance(value, float) else value)


def commands() -> str:
    group: Any = typer.main.get_command(cli)
    rows = [(code(f"versant {name}"), group.commands[name].help.split("\n\n")[0]) for name in COMMANDS]
    return table(("command", "does"), rows)


def operations() -> list[tuple[str, str, str]]:
    """(verb, path, summary) of every route."""
    application = create_app(Settings(database_url="postgresql://nobody@localhost/none"))
    return [
        (verb.upper(), path, operation["summary"])
        for path, item in application.openapi()["paths"].items()
        for verb, operation in item.items()
    ]


def command_options() -> str:
    """A section for each command, and for each command of a group."""
    group: Any = typer.main.get_command(cli)
    parts = []
    for name in COMMANDS:
        command = group.commands[name]
        inner = getattr(command, "commands", None)
        named = {name: command} if inner is None else {f"{name} {one}": inner[one] for one in inner}
        parts += [_command_section(full, one) for full, one in named.items()]
    return "\n" + "\n".join(parts) + "\n"


def _command_section(name: str, command: Any) -> str:
    rows = []
    for parameter in command.params:
        if parameter.name == "help" or getattr(parameter, "hidden", False):
            continue
        metavar = parameter.metavar or ""
        shown = (
            metavar
            if parameter.param_type_name == "argument"
            else " ".join(parameter.opts + parameter.secondary_opts)
        )
        rows.append((code(shown), plain_default(parameter), parameter.help or ""))
    lines = "\n".join(line.strip() for line in inspect.cleandoc(command.help or "").splitlines())
    return f"### versant {name}\n\n{lines}\n\n{table(('argument or option', 'default', 'meaning'), rows)}"


def plain_default(parameter: Any) -> str:
    """A default, where it is one that a person would want to read."""
    if parameter.required or callable(parameter.default) or parameter.default in (None, False, (), []):
        return ""
    return plain(parameter.default) if isinstance(parameter.default, str | int | float) else ""


def segment_properties() -> str:
    return _properties(SEGMENTS)


def way_properties() -> str:
    return _properties(WAYS)


def _properties(collection: Collection) -> str:
    rows = [
        (code(item.name), item.format or item.type, item.unit or "", item.description)
        for item in collection.properties.values()
    ]
    return table(("property", "type", "unit", "meaning"), rows)


def routes() -> str:
    return table(("", "route", "what"), [(verb, code(path), what) for verb, path, what in operations()])


def settings() -> str:
    rows = []
    for name, field in Settings.model_fields.items():
        # A default that depends on the machine is told in words.
        shown = "" if field.default_factory or field.default is None else plain(field.default)
        rows.append((code(ENV_PREFIX + name.upper()), shown, " ".join((field.description or "").split())))
    return table(("variable", "default", "meaning"), rows)


def formats() -> str:
    rows = [
        (code(name), item.description, " ".join(map(code, item.suffixes))) for name, item in FORMATS.items()
    ]
    return table(("format", "what", "usual suffixes"), rows)


def methods() -> str:
    rows = [
        (
            code(name) + (" (default)" if name == DEFAULT_METHOD else ""),
            item.description,
            "; ".join(item.needs),
            item.source,
        )
        for name, item in METHODS.items()
    ]
    return table(("method", "what", "needs", "source"), rows)


def options() -> str:
    parts = []
    models = {
        "every method": Options,
        **{code(name): method.options_model for name, method in METHODS.items()},
    }
    for name, model in models.items():
        rows = [
            (code(option), plain(fact.default), fact.allowed, fact.description)
            for option, fact in option_facts(model).items()
            if model is Options or option not in Options.model_fields
        ]
        parts.append(f"<details><summary>Options of {name}</summary>\n\n")
        parts.append(table(("option", "default", "allowed", "meaning"), rows) + "\n</details>\n\n")
    return "".join(parts).rstrip("\n") + "\n"


def windows() -> str:
    return table(("window", "what"), [(code(name), item.description) for name, item in WINDOWS.items()])


def resamplers() -> str:
    rows = [
        (code(name), (inspect.getdoc(item) or "").partition("\n")[0]) for name, item in RESAMPLERS.items()
    ]
    return table(("scheme", "what"), rows)


def triggers() -> str:
    return table(("trigger", "what"), [(code(name), item.description) for name, item in TRIGGERS.items()])


def positionings() -> str:
    rows = [(code(name), item.description, item.source) for name, item in POSITIONINGS.items()]
    return table(("name", "what", "source"), rows)


def solver_options() -> str:
    parts = []
    for name, solver in SOLVERS.items():
        rows = [
            (code(option), plain(fact.default), fact.allowed, fact.description)
            for option, fact in option_facts(solver.options_model).items()
        ]
        if rows:
            parts.append(f"<details><summary>Options of {code(name)}</summary>\n\n")
            parts.append(table(("option", "default", "allowed", "meaning"), rows) + "\n</details>\n\n")
    return "".join(parts).rstrip("\n") + "\n"


def outputs() -> str:
    rows = [
        (code(name), " ".join(map(code, item.suffixes)), item.description) for name, item in EXPORTS.items()
    ]
    return table(("format", "suffix", "what"), rows)


def consumer_formats() -> str:
    rows = [
        (
            code(name),
            item.consumer,
            " ".join(map(code, item.suffixes)),
            item.description.removesuffix(f" ({item.consumer})"),
        )
        for name, item in EXPORTS.items()
        if item.consumer
    ]
    return table(("name", "for", "suffixes", "what"), rows)


def consumer_options() -> str:
    rows = [
        (code(name), code(option), plain(fact.default), fact.allowed, fact.description)
        for name, item in EXPORTS.items()
        if item.consumer
        for option, fact in option_facts(item.options).items()
    ]
    return table(("name", "option", "default", "allowed", "meaning"), rows)


def metrics() -> str:
    """Every metric that a service with a database exposes."""
    nothing = Gauges({}, {}, dict.fromkeys(GAUGES, 0.0), {})
    rows = []
    for family in Metrics(lambda: nothing).registry.collect():
        name = f"{family.name}_total" if family.type == "counter" else family.name
        labels = {label for measure in MEASURES if measure.name == name for label in measure.labels}
        labels |= set(LABELS.get(name, ()))
        rows.append((code(name), family.type, " ".join(map(code, sorted(labels))), family.documentation))
    return table(("metric", "kind", "labels", "meaning"), rows)


MAKERS: dict[str, Callable[[], str]] = {
    maker.__name__: maker
    for maker in (
        commands,
        command_options,
        segment_properties,
        way_properties,
        routes,
        settings,
        formats,
        methods,
        options,
        windows,
        resamplers,
        triggers,
        positionings,
        solver_options,
        outputs,
        consumer_formats,
        consumer_options,
        metrics,
    )
}


def written_tables() -> list[tuple[str, str]]:
    """Name and content of every table on the pages."""
    tables = [table for page in PAGES for table in TABLE.findall(page.read_text())]
    return [(name, content) for name, content in tables if name not in EXPERIMENTS]


def test_every_table_is_there_once() -> None:
    assert sorted(name for name, _ in written_tables()) == sorted(MAKERS)


@pytest.mark.parametrize("name", MAKERS)
def test_table_says_what_the_code_does(name: str) -> None:
    written = dict(written_tables())[name]
    assert written == MAKERS[name](), "run: make tables"


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    for one in PAGES:
        one.write_text(
            TABLE.sub(
                lambda match: (
                    f"<!-- table: {match[1]} -->\n{MAKERS[match[1]]()}<!-- end -->"
                    if match[1] in MAKERS
                    else match[0]
                ),
                one.read_text(),
            )
        )
