"""The documents say what the code does: their tables are made from the code.

``make tables`` renews them.
"""

from __future__ import annotations

import inspect
import sys
from collections import Counter
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
from app.ops.metrics import GAUGES, LABELS, STANDBY, Gauges, Metrics
from document_pages import PAGES, TABLE
from fusion.catalogue import METHODS, POSITIONINGS, SOLVERS
from fusion.filters.resampling import RESAMPLERS
from fusion.filters.triggers import TRIGGERS
from fusion.formats import FORMATS
from fusion.methods.base import Options
from fusion.options import option_facts
from fusion.registry import DEFAULT_METHOD
from fusion.terrain.windows import WINDOWS

SHARED_BY = 4
"""Options that so many commands share are listed once."""
OPTION_HEAD = ("argument or option", "meaning")
PROPERTY_HEAD = ("property", "type", "unit", "meaning")
EXPERIMENTS = {"calais", "lahrech", "saadaoui", "surveyed", "methods_on_roads"}
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
    """Every command with its first sentence, linked to its options further down; groups have a section a command."""
    group: Any = typer.main.get_command(cli)
    rows = []
    for name in COMMANDS:
        inner = getattr(group.commands[name], "commands", None)
        names = [name] if inner is None else [f"{name} {one}" for one in inner]
        links = ", ".join(f"[`versant {one}`](#versant-{one.replace(' ', '-')})" for one in names)
        rows.append((links, _paragraphs(group.commands[name])[0]))
    return table(("command", "does"), rows)


def _paragraphs(command: Any) -> list[str]:
    return inspect.cleandoc(command.help or "").split("\n\n")


def operations() -> list[tuple[str, str, str]]:
    """(verb, path, summary) of every route."""
    application = create_app(Settings(database_url="postgresql://nobody@localhost/none"))
    return [
        (verb.upper(), path, operation["summary"])
        for path, item in application.openapi()["paths"].items()
        for verb, operation in item.items()
    ]


def command_options() -> str:
    """The options that many commands share, then a section for each command, and for each command of a group."""
    group: Any = typer.main.get_command(cli)
    named: dict[str, Any] = {}
    for name in COMMANDS:
        inner = getattr(group.commands[name], "commands", None)
        named |= (
            {name: group.commands[name]} if inner is None else {f"{name} {k}": v for k, v in inner.items()}
        )
    rows = {
        name: [_parameter_row(p) for p in command.params if _is_shown(p)] for name, command in named.items()
    }
    count = Counter(row for of_command in rows.values() for row in of_command)
    shared = [row for row in count if count[row] >= SHARED_BY]
    parts = [f"### Options of many commands\n\n{table(OPTION_HEAD, shared)}"]
    for name, command in named.items():
        own = [row for row in rows[name] if row not in shared]
        also = ", ".join(row[0] for row in rows[name] if row in shared)
        text = "\n\n".join(_paragraphs(command)[name in COMMANDS :])
        parts += [
            "\n".join([f"### versant {name}\n", *map(str.strip, text.splitlines()), ""]).rstrip("\n") + "\n"
        ]
        parts += [table(OPTION_HEAD, own)] if own else []
        parts += [f"{'Also' if own else 'Options'}: {also}.\n"] if also else []
    return "\n" + "\n".join(parts) + "\n"


def _is_shown(parameter: Any) -> bool:
    return parameter.name != "help" and not getattr(parameter, "hidden", False)


def _parameter_row(parameter: Any) -> tuple[str, str]:
    """An option, or an argument, with its meaning, in which its default stands."""
    argument = parameter.metavar or parameter.name.upper()
    names = " ".join(parameter.opts + parameter.secondary_opts)
    shown = argument if parameter.param_type_name == "argument" else names
    default = plain_default(parameter)
    return code(shown), " ".join([parameter.help or "", *([f"[default: {default}]"] if default else [])])


def plain_default(parameter: Any) -> str:
    """A default, where it is one that a person would want to read."""
    if parameter.required or callable(parameter.default) or parameter.default in (None, False, (), []):
        return ""
    return plain(parameter.default) if isinstance(parameter.default, str | int | float) else ""


def segment_properties() -> str:
    return table(PROPERTY_HEAD, _property_rows(SEGMENTS))


def way_properties() -> str:
    """Those that segments do not have, or have with another meaning."""
    of_segments = _property_rows(SEGMENTS)
    return table(PROPERTY_HEAD, [row for row in _property_rows(WAYS) if row not in of_segments])


def _property_rows(collection: Collection) -> list[tuple[str, ...]]:
    return [
        (code(item.name), item.format or item.type, item.unit or "", item.description)
        for item in collection.properties.values()
    ]


def routes() -> str:
    """A row for each path, with the summary of each verb."""
    by_path: dict[str, list[str]] = {}
    for verb, path, what in operations():
        by_path.setdefault(path, []).append(f"{verb}: {what}")
    return table(("route", "what"), [(code(path), "; ".join(what)) for path, what in by_path.items()])


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
    every = _option_rows(Options)
    models = {name: method.options_model for name, method in METHODS.items()}
    rows = {name: [row for row in _option_rows(model) if row not in every] for name, model in models.items()}
    tables = [_folded("every method", table(("option", "default", "meaning"), every))]
    return "\n".join(tables + [_family_table(family, rows) for family in _families(rows)])


OptionRow = tuple[str, str, str]
"""Option, default, meaning with what is allowed."""


def _option_rows(model: Any) -> list[OptionRow]:
    rows = []
    for option, fact in option_facts(model).items():
        bounds = "" if fact.allowed in ("", "true, false") else f" [{fact.allowed}]"
        rows.append((code(option), plain(fact.default), fact.description + bounds))
    return rows


def _families(rows: dict[str, list[OptionRow]]) -> list[list[str]]:
    """Names of which each shares most options with the first of its family."""
    named = {name: {row[0] for row in own} for name, own in rows.items()}
    families: list[list[str]] = []
    for name, own in named.items():
        alike = (f for f in families if 2 * len(own & named[f[0]]) > max(len(own), len(named[f[0]])))
        family = next(alike, None)
        if family is None:
            families.append([name])
        else:
            family.append(name)
    return families


def _family_table(family: list[str], rows: dict[str, list[OptionRow]]) -> str:
    """The options of a family, with the default of each member, or one if all are equal; a dash for no such option."""
    defaults = {
        name: {(option, meaning): default for option, default, meaning in rows[name]} for name in family
    }
    lines = []
    for option, meaning in dict.fromkeys(kind for name in family for kind in defaults[name]):
        of_each = [defaults[name].get((option, meaning), "–") for name in family]
        shown = of_each[0] if len(set(of_each)) == 1 else ", ".join(of_each)
        lines.append((option, shown, meaning))
    head = "default" if len(family) == 1 else "default of each, or of all"
    return _folded(", ".join(map(code, family)), table(("option", head, "meaning"), lines))


def _folded(names: str, content: str) -> str:
    return f"<details><summary>Options of {names}</summary>\n\n{content}\n</details>\n"


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
    rows = {name: _option_rows(solver.options_model) for name, solver in SOLVERS.items()}
    return "\n".join(_family_table([name], rows) for name in rows if rows[name])


def outputs() -> str:
    rows = [
        (code(name), " ".join(map(code, item.suffixes)), item.description) for name, item in EXPORTS.items()
    ]
    return table(("format", "suffix", "what"), rows)


def consumer_options() -> str:
    """One row for each option; formats that share it stand together."""
    sharing: dict[tuple[str, ...], list[str]] = {}
    for name, item in EXPORTS.items():
        for row in _option_rows(item.options) if item.consumer else ():
            sharing.setdefault(row, []).append(code(name))
    rows = [(" ".join(names), *row) for row, names in sharing.items()]
    return table(("name", "option", "default", "meaning"), rows)


def metrics() -> str:
    """Every metric that a service with a database exposes."""
    nothing = Gauges({}, {}, dict.fromkeys(GAUGES, 0.0), {})
    rows = [(code(f"versant_{name}"), "gauge", "", meaning) for name, meaning in STANDBY.items()]
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
