"""In a German locale no help, heading or wrong usage is English: every parser is walked over."""

from __future__ import annotations

import ast
import importlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

import app.cli
from app.cli.drives.look import drives
from app.cli.words.parser import in_words, paragraphs, usage_in_words
from fusion.messages import TERMS, catalogue
from source_tree import REPOSITORY

WORDS = catalogue("de")[TERMS]
COMMANDS = ("app/cli", "app/demo", "app/batch", "app/upkeep")


@pytest.fixture(autouse=True)
def german(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")


def parsers(command: Any) -> Iterator[Any]:
    """A command and all below it."""
    yield command
    for name in getattr(command, "commands", {}):
        yield from parsers(command.commands[name])


def helps() -> set[str]:
    """Every paragraph of every parser's help, as it stands in the code."""
    modules = {one.module for one in app.cli.COMMANDS.values()}
    roots = [app.cli.app, *(importlib.import_module(one).app for one in modules)]
    found = {one.summary for one in app.cli.COMMANDS.values()}
    for command in (one for root in roots for one in parsers(_english(root))):
        found |= {command.help or "", command.epilog or ""}
        found |= {getattr(one, "help", None) or "" for one in command.params}
    return {" ".join(one.split()) for text in found for one in text.split("\n\n")} - {""}


def _english(root: typer.Typer) -> Any:
    with pytest.MonkeyPatch.context() as context:
        context.setenv("LC_ALL", "C")
        command = typer.main.get_command(root)
    if root is app.cli.app:  # its commands are those of the modules
        command.commands = {}
    return command


def test_each_paragraph_of_help_is_in_the_catalogue() -> None:
    assert helps() - set(WORDS) == set()


def test_typers_own_words_are_in_the_catalogue() -> None:
    asked = set()
    for path in Path(typer.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "_":
                asked |= {one.value for one in node.args if isinstance(one, ast.Constant)}
    # This one gets a hint behind it, and is translated with that.
    assert asked - {"No such command {name!r}."} - set(WORDS) == set()


def test_headings_of_tables_are_in_the_catalogue() -> None:
    wanted: set[str] = set()
    for folder in COMMANDS:
        for path in (REPOSITORY / folder).rglob("*.py"):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            given = {
                target.id: node.value
                for node in ast.walk(tree)
                if isinstance(node, ast.Assign)
                for target in node.targets
                if isinstance(target, ast.Name)
            }
            for node in ast.walk(tree):
                if isinstance(node, ast.Call) and ast.unparse(node.func) == "console.table":
                    heads = node.args[0]
                    heads = given.get(heads.id, heads) if isinstance(heads, ast.Name) else heads
                    title = next((one.value for one in node.keywords if one.arg == "title"), None)
                    wanted |= {one.value for one in ast.walk(heads) if isinstance(one, ast.Constant)}
                    wanted |= {title.value} if isinstance(title, ast.Constant) else set()
    assert {"file", "within 1.96 sigma", "to do"} <= wanted
    assert wanted - {""} - set(WORDS) == set()


@pytest.mark.parametrize(
    ("said", "german_words"),
    [
        (
            "No such option: --x (Possible options: --a, --b)",
            "Es gibt keine Option --x (mögliche Optionen: --a, --b)",
        ),
        (
            "No such command 'uplod'. Did you mean 'upload'?",
            "Es gibt keinen Befehl 'uplod'. Meinten Sie 'upload'?",
        ),
        ("Missing argument 'LOG...'.", "Es fehlt das Argument 'LOG...'."),
        (
            "Invalid value for '--limit': 'x' is not a valid int range.",
            "Unbrauchbarer Wert für '--limit': 'x' ist nicht vom Typ ganze Zahl in einem Bereich.",
        ),
        (
            "Invalid value for '--dem': File 'a.tif' does not exist.",
            "Unbrauchbarer Wert für '--dem': Die Datei 'a.tif' gibt es nicht.",
        ),
        ("Something else.", "Something else."),
    ],
)
def test_wrong_usage_is_said_by_the_template_that_it_fits(said: str, german_words: str) -> None:
    assert usage_in_words(said) == german_words


def test_a_command_speaks_german_and_another_process_english(monkeypatch: pytest.MonkeyPatch) -> None:
    german_help = in_words(typer.main.get_command(drives)).commands["list"]
    assert german_help.help.startswith("Fahrten auflisten")
    limit = next(one for one in german_help.params if one.name == "limit")
    assert limit.help == "Höchstens so viele."
    assert german_help.get_usage(typer.Context(german_help)).startswith("Aufruf:")
    assert paragraphs("At most so many.\n\nUnknown to it.") == "Höchstens so viele.\n\nUnknown to it."
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    english = in_words(typer.main.get_command(drives)).commands["list"]
    assert re.match("Usage:", english.get_usage(typer.Context(english)))
    assert usage_in_words("Missing command.") == "Missing command."
