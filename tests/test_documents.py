"""What the text of the documents names exists: commands, options, settings, routes, targets, files and headings."""

from __future__ import annotations

import re
import shlex
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer

from app.cli import COMMANDS
from app.cli import app as cli
from app.core.settings import ENV_PREFIX, Settings
from app.main import create_app
from app.web.guides import sections, slug
from document_pages import DOCS, PAGES, README, TABLE, prose
from source_tree import REPOSITORY

MOST_WORDS = 700
"""Of README."""


def test_the_readme_is_short() -> None:
    assert len(README.read_text().split()) <= MOST_WORDS


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


def routes() -> list[str]:
    application = create_app(Settings(database_url="postgresql://nobody@localhost/none"))
    return [*application.openapi()["paths"], "/openapi.json"]


def test_routes_in_the_text_exist() -> None:
    patterns = [re.sub(r"\{\w+\}", r"[^/]+", path) for path in routes()]
    named = re.findall(r"(?<![\w.])(/(?:v1|tiles|collections|problems|openapi)[^\s`'?),;]*)", prose())
    assert named
    for path in named:
        assert any(re.fullmatch(pattern, path) for pattern in patterns), path


def test_what_a_request_does_that_is_sent_again_is_told_of_every_one() -> None:
    paths = create_app(Settings(database_url="postgresql://nobody@localhost/none")).openapi()["paths"]
    text = (DOCS / "reference/http.md").read_text()
    section = text.partition("## When an answer is lost")[2].partition("\n## ")[0]
    told = re.findall(
        r"`(/\S+)`", "\n".join(line.split("|")[1] for line in section.splitlines() if "| `/" in line)
    )
    assert sorted(told) == sorted(path for path, methods in paths.items() if "post" in methods)


def test_make_targets_in_the_text_exist() -> None:
    makefile = (REPOSITORY / "Makefile").read_text()
    named = re.findall(r"(?:`|^)make ([a-z]+)", prose(), re.MULTILINE)
    assert {"demo", "test"} <= set(named)
    for target in named:
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPOSITORY).as_posix())
def test_files_in_the_text_exist(page: Path) -> None:
    text = TABLE.sub("", page.read_text())
    named = re.findall(r"`((?:fusion|app|tests|benchmarks|migrations|docs)/[\w/.-]+)`", text)
    assert [name for name in named if "NAME" not in name and not (REPOSITORY / name).exists()] == []
    links = re.findall(r"\]\(((?!https?:)[^)#]+)", text)
    assert [name for name in links if not (page.parent / name).exists()] == []


FOREIGN_NAMES = ("AWS_", "UBX_", "VERSANT_")
"""Beginnings of names in capitals that are no constants of the code."""


@cache
def sources() -> str:
    """The text of all Python files."""
    folders = ("app", "fusion", "tests", "benchmarks")
    paths = [path for folder in folders for path in (REPOSITORY / folder).rglob("*.py")]
    return "\n".join(path.read_text() for path in paths if "node_modules" not in path.parts)


def test_constants_in_the_text_exist() -> None:
    named = set(re.findall(r"`([A-Z][A-Z0-9]*(?:_[A-Z0-9]+)+)`", prose()))
    words = set(re.findall(r"\w+", sources()))
    assert len(named) > 20
    assert {name for name in named if not name.startswith(FOREIGN_NAMES)} <= words


def test_benchmarks_in_the_text_exist_with_their_options() -> None:
    folder = REPOSITORY / "benchmarks"
    shared = "".join(path.read_text() for path in (folder / "accuracy").glob("*.py"))
    found = re.findall(r"python (?:benchmarks/(\w+)\.py|-m ([a-z][\w.]+))([^`\n(]*)", prose())
    seen = 0
    for script, module, rest in found:
        place = folder / (script or module.replace(".", "/"))
        if module and not place.exists() and not place.with_suffix(".py").exists():
            assert module in {"pytest"}, module
            continue
        path = place / "__main__.py" if place.is_dir() else place.with_suffix(".py")
        assert path.exists(), path
        text = path.read_text() + shared
        for flag in re.findall(r"(?<!\S)(--[a-z][a-z-]*)", rest):
            assert f'"{flag}"' in text, f"{path.name} {flag}"
        seen += 1
    assert seen > 30


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPOSITORY).as_posix())
def test_headings_that_links_name_exist(page: Path) -> None:
    broken = []
    for path, anchor in re.findall(r"\]\(((?!https?:)[^)#]*)#([^)]+)\)", page.read_text()):
        target = (page.parent / path).resolve() if path else page
        headings = re.findall(r"^#+ (.*)$", target.read_text(), re.MULTILINE)
        if anchor not in {slug(heading.replace("`", "")) for heading in headings}:
            broken.append(f"{path}#{anchor}")
    assert broken == []


def test_the_index_lists_every_page_once() -> None:
    pages = [page.relative_to(DOCS).as_posix() for page in PAGES if page.is_relative_to(DOCS)]
    listed = [f"{name}.md" for section in sections() for name, _ in section.pages]
    assert sorted([*listed, "index.md"]) == pages


def test_folders_of_the_layout_exist() -> None:
    (block,) = re.findall(r"```\n(fusion/ .*?)```", prose(), re.DOTALL)
    parent = ""
    for line in block.splitlines():
        for name in re.findall(r"(?:^|\s)([a-z_]+/|[a-z_]+\.py)(?=\s|,|;|$)", line):
            top = not line.startswith(" ")
            parent = name if top else parent
            place = REPOSITORY / (name if top else parent + name)
            assert place.exists(), place
