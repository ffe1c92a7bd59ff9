"""The house: which room may look into which, how large rooms and files are, and that tests stand as the sources do."""

from __future__ import annotations

import ast
import re
import statistics
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from source_tree import REPOSITORY, imports_of, lines_of, sources, text_of_file, tree_of

LONGEST_FILE_LINES = 350
MOST_FILES_IN_A_FOLDER = 22
MEDIAN_LINES = (100, 250)

DOCSTRING = re.compile(r'(#.*\n)*r?"""[^"]')

GROUND = {"arrays", "types", "signals", "errors", "messages", "registry", "options", "frames", "compiled"}
"""What every room of the library stands on: files at its root, beside the pipeline."""

LIBRARY = {
    "filters": set(),
    "formats": set(),
    "gnss": {"filters"},
    "roads": set(),
    "terrain": {"roads"},
    "matching": {"roads"},
    "network": {"roads", "filters"},
    "methods": {"gnss", "roads", "terrain", "matching", "network"},
    "profile": {"filters", "roads", "terrain", "matching", "methods", "network"},
    "published": {"filters", "gnss", "roads", "terrain", "matching", "methods", "network", "simulate"},
    "catalogue": {"gnss", "methods", "profile", "published"},
    "report": {"formats", "methods", "terrain"},
    "pipeline": {"catalogue", "gnss", "methods", "report", "roads", "terrain"},
    "lags": {"methods", "network"},
    "together": {"lags", "methods", "network", "roads", "terrain"},
    "results": {"methods", "network", "together", "roads", "terrain"},
    "scoring": {"simulate"},
    "simulate": {"formats", "gnss", "roads"},
    "__init__": {"formats", "pipeline", "results", "roads", "terrain"},
}
"""Room -> the rooms of the library that it may import from."""

AT_THE_ROOT = {"catalogue", "lags", "pipeline", "report", "results", "together", "__init__"}
"""Files at the library's root beside the ground: all that has a name, one drive through everything, its report, several
drives with the lags of their altimeters, their tables, and the front door, which offers names of the rooms to scripts
and loads none of them before it is asked for."""

SERVICE = {
    "access": {"core"},
    "core": set(),
    "embedded": {"core"},
    "jobs": {"core"},
    "roads": {"core", "network", "terrain"},
    "terrain": {"core", "network"},
    "network": {"core", "jobs"},
    "map": {"changes", "core", "network", "roads", "terrain"},
    "drives": {
        "access",
        "changes",
        "core",
        "exports",
        "jobs",
        "map",
        "network",
        "operations",
        "releases",
        "roads",
        "terrain",
    },
    "ops": {"core", "drives", "map", "network", "roads"},
    "upkeep": {"changes", "core", "drives", "embedded", "network", "ops", "terrain"},
    "releases": {"changes", "core", "exports", "map", "network"},
    "operations": {"core", "jobs", "map", "network", "releases", "roads", "terrain"},
    "main": {
        "access",
        "changes",
        "core",
        "drives",
        "exports",
        "map",
        "operations",
        "ops",
        "releases",
        "web",
    },
    "web": {"core", "map"},
    "changes": {"core", "jobs", "network"},
    "batch": {"cli", "core", "drives", "exports", "jobs", "map", "network", "terrain"},
    "cli": {
        "access",
        "core",
        "drives",
        "embedded",
        "exports",
        "jobs",
        "main",
        "map",
        "network",
        "releases",
        "roads",
        "terrain",
        "upkeep",
    },
    "exports": {"core", "jobs", "map", "network", "roads", "terrain"},
    "demo": {"access", "cli", "core", "embedded", "map", "roads", "terrain"},
}
"""Room -> the rooms of the service that it may import from."""


def room(path: Path) -> str:
    """The room of a file: its folder below the package, or its own name at the package's root."""
    return path.parts[1] if len(path.parts) > 2 else path.stem


def modules() -> list[Path]:
    """Every file of the library and of the service but ``__init__`` and ``__main__``."""
    return [path for path in sources("fusion") + sources("app") if not path.stem.startswith("__")]


def test_no_file_imports_itself_through_others() -> None:
    graph = {path: imports_of(path) for package in ("fusion", "app") for path in sources(package)}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(str(path) for path in error.args[1]))


def test_a_circle_would_be_seen() -> None:
    with pytest.raises(CycleError):
        TopologicalSorter({"a": {"b"}, "b": {"c"}, "c": {"a"}}).prepare()


def test_rooms_of_the_library_look_downwards_only() -> None:
    wrong = [
        f"{path} -> {target}"
        for path in sources("fusion")
        for target in imports_of(path)
        if room(path) != room(target)
        and room(target) not in GROUND
        and room(target) not in LIBRARY.get(room(path), set())
    ]
    assert wrong == []


def test_rooms_of_the_service_look_downwards_only() -> None:
    wrong = [
        f"{path} -> {target}"
        for path in sources("app")
        for target in imports_of(path)
        if target.parts[0] == "app" and room(path) != room(target) and room(target) not in SERVICE[room(path)]
    ]
    assert wrong == []
    assert {room(path) for path in sources("app")} - {"__init__"} == set(SERVICE)


def test_the_root_of_the_library_holds_the_ground_and_what_ties_all_together() -> None:
    files = {path.stem for path in sources("fusion") if len(path.parts) == 2}
    assert files == GROUND | AT_THE_ROOT
    folders = {path.parts[1] for path in sources("fusion") if len(path.parts) > 2}
    assert folders == set(LIBRARY) - AT_THE_ROOT


def test_files_stay_small() -> None:
    folders = ("app", "fusion", "migrations", "tests", "benchmarks")
    lengths = {path: lines_of(path) for folder in folders for path in sources(folder)}
    assert {str(path): n for path, n in lengths.items() if n > LONGEST_FILE_LINES} == {}


def test_files_are_no_fragments_on_the_whole() -> None:
    low, high = MEDIAN_LINES
    assert low <= statistics.median(map(lines_of, modules())) <= high


def test_no_folder_is_a_crowd() -> None:
    files = Counter(path.parent for package in ("fusion", "app", "benchmarks") for path in sources(package))
    crowds = {str(folder): n for folder, n in files.items() if n > MOST_FILES_IN_A_FOLDER}
    assert crowds == {}, f"more than {MOST_FILES_IN_A_FOLDER} files: give those of one kind a folder"


def test_every_module_says_what_it_is_for() -> None:
    everything = [path for folder in ("fusion", "app", "benchmarks", "tests") for path in sources(folder)]
    silent = [str(path) for path in everything if not DOCSTRING.match(text_of_file(path))]
    assert silent == []


@pytest.mark.parametrize("text", ["", "import os\n", '""""""\n', '# a note\nx = """text"""\n'])
def test_a_module_that_says_nothing_would_be_seen(text: str) -> None:
    assert not DOCSTRING.match(text)


def test_no_module_offers_what_another_defines() -> None:
    """``__all__`` is for what holds a registry, and for fixtures that tests share."""
    offering = {
        path
        for path in sources("fusion") + sources("app")
        for node in tree_of(path).body
        if isinstance(node, ast.Assign)
        and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)
    }
    assert {path.name for path in offering} <= {"__init__.py", "catalogue.py"}
    holding = {
        path
        for path in offering
        if any(isinstance(node, ast.Attribute) and node.attr == "add" for node in ast.walk(tree_of(path)))
    }
    assert offering == holding


def test_tests_stand_as_the_sources_do() -> None:
    lost = {
        str(path.parent)
        for top in ("fusion", "app", "benchmarks")
        for path in sources(f"tests/{top}")
        if not (REPOSITORY / path.parent.relative_to("tests")).is_dir()
    }
    assert lost == set()
