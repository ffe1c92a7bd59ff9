"""The documents say what the code does: their tables are made from the code, and names in README's text exist.

``python tests/test_readme.py --write`` renews the tables.
"""

from __future__ import annotations

import inspect
import re
import shlex
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import pytest
import typer

from app.cli import COMMANDS
from app.cli import app as cli
from app.core.settings import ENV_PREFIX, Settings
from app.core.telemetry.measures import MEASURES
from app.exports.formats import FORMATS as EXPORTS
from app.main import create_app
from app.map.handover import HANDOVERS
from app.map.segment import PROPERTIES
from app.ops.metrics import GAUGES, LABELS, Gauges, Metrics
from fusion.catalogue import METHODS, POSITIONINGS, SOLVERS
from fusion.filters.resampling import RESAMPLERS
from fusion.filters.triggers import TRIGGERS
from fusion.formats import FORMATS
from fusion.methods.base import Options, option_facts
from fusion.registry import DEFAULT_METHOD
from fusion.terrain.windows import WINDOWS

REPOSITORY = Path(__file__).resolve().parents[1]
README = REPOSITORY / "README.md"
PAGES = (
    README,
    *(
        REPOSITORY / ".docs" / name
        for name in ("methods.md", "positioning.md", "operation.md", "handover.md")
    ),
)
TABLE = re.compile(r"<!-- table: (\w+) -->\n(.*?)<!-- end -->", re.DOTALL)


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


def routes() -> str:
    return table(("", "route", "what"), [(verb, code(path), what) for verb, path, what in operations()])


def settings() -> str:
    rows = []
    for name, field in Settings.model_fields.items():
        # A default that depends on the machine is told in words.
        shown = "" if field.default_factory or field.default is None else plain(field.default)
        rows.append((code(ENV_PREFIX + name.upper()), shown, field.description))
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


def handovers() -> str:
    rows = [
        (code(name), item.consumer, " ".join(map(code, item.suffixes)), item.description)
        for name, item in HANDOVERS.items()
    ]
    return table(("name", "for", "suffixes", "what"), rows)


def handover_options() -> str:
    rows = [
        (code(name), code(option), plain(fact.default), fact.allowed, fact.description)
        for name, item in HANDOVERS.items()
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
        handovers,
        handover_options,
        metrics,
    )
}


def written_tables() -> list[tuple[str, str]]:
    """Name and content of every table on the pages."""
    return [found for page in PAGES for found in TABLE.findall(page.read_text())]


def test_every_table_is_there_once() -> None:
    assert sorted(name for name, _ in written_tables()) == sorted(MAKERS)


@pytest.mark.parametrize("name", MAKERS)
def test_table_says_what_the_code_does(name: str) -> None:
    written = dict(written_tables())[name]
    assert written == MAKERS[name](), "run: python tests/test_readme.py --write"


def prose() -> str:
    """README without its generated tables."""
    return TABLE.sub("", README.read_text())


def test_commands_in_the_text_exist_with_their_options() -> None:
    group: Any = typer.main.get_command(cli)
    found = re.findall(r"versant ([a-z][a-z-]*)((?: [^`#\n]*)?)", prose())
    assert found
    for name, rest in found:
        if name not in COMMANDS:
            assert not rest.strip().startswith("-"), name
            assert name in {"command"}, f"versant {name}"
            continue
        command, words = group.commands[name], shlex.split(rest.replace("&", ""))
        if hasattr(command, "commands"):  # a group: its command comes first
            command = command.commands[words.pop(0)]
        known = {flag for parameter in command.params for flag in parameter.opts}
        for word in words:
            if word.startswith("-"):
                assert word in known | {"--help"}, f"versant {name} {word}"


def test_variables_in_the_text_exist() -> None:
    known = {ENV_PREFIX + name.upper() for name in Settings.model_fields}
    named = set(re.findall(r"VERSANT_[A-Z_]+", prose()))
    assert named
    assert named <= known


def test_routes_in_the_text_exist() -> None:
    patterns = [re.sub(r"\{\w+\}", r"[^/]+", path) for _, path, _ in operations()] + ["/openapi.json"]
    named = re.findall(r"(?<![\w.])(/(?:v1|tiles|collections|problems|openapi)[^\s`'?),;]*)", prose())
    assert named
    for path in named:
        assert any(re.fullmatch(pattern, path) for pattern in patterns), path


def test_properties_are_all_named_in_order() -> None:
    (sentence,) = re.findall(r"Properties in every output: (.*?)\. Files", prose(), re.DOTALL)
    assert tuple(re.findall(r"`(\w+)`", sentence)) == PROPERTIES


def test_make_targets_in_the_text_exist() -> None:
    makefile = (REPOSITORY / "Makefile").read_text()
    named = re.findall(r"(?:`|^)make ([a-z]+)", prose(), re.MULTILINE)
    assert {"demo", "test"} <= set(named)
    for target in named:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


def test_files_in_the_text_exist() -> None:
    for page in (README, *sorted((REPOSITORY / ".docs").glob("*.md"))):
        text = TABLE.sub("", page.read_text())
        named = re.findall(r"`((?:fusion|app|tests|benchmarks|migrations)/[\w/.]+)`", text)
        links = re.findall(r"\]\(((?!https?:)[^)#]+)\)", text)
        assert named or links, page
        for name in named:
            if "NAME" not in name:
                assert (REPOSITORY / name).exists(), f"{page.name}: {name}"
        for name in links:
            assert (page.parent / name).exists(), f"{page.name}: {name}"


def test_folders_of_the_layout_exist() -> None:
    (block,) = re.findall(r"```\n(fusion/ .*?)```", prose(), re.DOTALL)
    parent = ""
    for line in block.splitlines():
        for name in re.findall(r"(?:^|\s)([a-z_]+/|[a-z_]+\.py)(?=\s|,|;|$)", line):
            top = not line.startswith(" ")
            parent = name if top and name in {"fusion/", "app/"} else parent
            place = REPOSITORY / (name if top or name == "end_to_end/" else parent + name)
            if name == "end_to_end/":
                place = REPOSITORY / "tests" / name
            assert place.exists(), place


if __name__ == "__main__":
    if sys.argv[1:] != ["--write"]:
        sys.exit(__doc__)
    for one in PAGES:
        one.write_text(
            TABLE.sub(
                lambda found: f"<!-- table: {found[1]} -->\n{MAKERS[found[1]]()}<!-- end -->", one.read_text()
            )
        )
