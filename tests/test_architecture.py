"""The rules of the layout, held by reading the sources: who imports whom, where SQL and settings stand."""

from __future__ import annotations

import ast
import re
import subprocess
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from source_tree import REPOSITORY, imported_names, name_of, sources, text_of, tree_of

TOP_LEVEL = {
    "pyproject.toml",
    "README.md",
    "LICENSE",
    "CONTRIBUTING.md",
    "CHANGELOG.md",
    "Makefile",
    "docker-compose.yml",
    "app",
    "fusion",
    "migrations",
    "tests",
    "benchmarks",
    "docs",
}

SQL_PLACES = {
    Path("app") / place
    for place in (
        "access/quotas.py",
        "access/store.py",
        "access/zone_store.py",
        "changes/store.py",
        "changes/webhooks/store.py",
        "core/caller.py",
        "core/claims.py",
        "core/databases.py",
        "core/schema.py",
        "core/standby/store.py",
        "core/telemetry/audit.py",
        "core/telemetry/ledger.py",
        "drives/batches/importing.py",
        "drives/batches/removing_store.py",
        "drives/batches/store.py",
        "drives/queue.py",
        "drives/batches/selection.py",
        "drives/batches/touched.py",
        "drives/claims.py",
        "drives/listing.py",
        "drives/live/store.py",
        "drives/parts/reading.py",
        "drives/person/store.py",
        "drives/store.py",
        "drives/tracks.py",
        "drives/trials/store.py",
        "exports/making.py",
        "exports/source.py",
        "exports/store.py",
        "jobs/computations.py",
        "jobs/ended.py",
        "jobs/requests/store.py",
        "map/derived/following.py",
        "map/derived/drawn_store.py",
        "map/derived/waiting.py",
        "map/heights/store.py",
        "map/items/store.py",
        "map/store.py",
        "map/figures.py",
        "map/tiles/road_store.py",
        "map/tiles/store.py",
        "map/derived/way_store.py",
        "operations/store.py",
        "ops/admin/attention.py",
        "ops/admin/store.py",
        "ops/store.py",
        "releases/choosing.py",
        "releases/serving.py",
        "releases/store.py",
        "roads/copy.py",
        "roads/names.py",
        "roads/retired.py",
        "roads/changing.py",
        "roads/comparing.py",
        "roads/store.py",
        "terrain/coverage.py",
        "terrain/store.py",
        "upkeep/store.py",
    )
}
"""Beside ``app/network/``: each subject's statements stand beside the code that they belong to, in one of these."""

SQL_BUILDERS = {"text", "select", "insert", "update", "delete", "func"}
SQL_STATEMENT = re.compile(
    r"\s*(SELECT\s|INSERT\s+INTO\s|UPDATE\s+\w+\s+SET\s|DELETE\s+FROM\s|WITH\s+\w+\s+AS\s|TRUNCATE\s|COPY\s+\w+\s|"
    r"(CREATE|ALTER|DROP)\s+(TABLE|INDEX|VIEW|EXTENSION|DATABASE|FUNCTION|SCHEMA|TYPE)\s)"
)


def name_of_attribute(node: ast.AST) -> str:
    return node.attr if isinstance(node, ast.Attribute) else ""


def service_imports(tree: ast.Module) -> Iterator[int]:
    yield from (line for line, name in imported_names(tree) if name.split(".")[0] == "app")


def environment_reads(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute | ast.Name) and name_of(node) in {"environ", "environb", "getenv"}:
            yield node.lineno
        elif isinstance(node, ast.ImportFrom) and node.module == "os":
            yield from (node.lineno for a in node.names if a.name in {"environ", "environb", "getenv"})


def sql_statements(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if name_of_attribute(node) == "exec_driver_sql" or SQL_STATEMENT.match(text_of(node)):
            yield getattr(node, "lineno", 0)


def sql_builders(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "sqlalchemy":
            yield from (node.lineno for alias in node.names if alias.name in SQL_BUILDERS)


def settings_read_at_import(tree: ast.Module) -> Iterator[int]:
    for statement in tree.body:
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            continue
        for node in ast.walk(statement):
            if isinstance(node, ast.Call) and name_of(node.func) in {
                "Settings",
                "get_settings",
                "load_settings",
            }:
                yield node.lineno


Rule = Callable[[ast.Module], Iterator[int]]


def violations(rule: Rule, paths: list[Path]) -> list[str]:
    return [f"{path}:{line}" for path in paths for line in rule(tree_of(path))]


def outside_the_stores() -> list[Path]:
    inside = [path for path in sources("app") if path.parent == Path("app/network") or path in SQL_PLACES]
    return [path for path in sources("app") + sources("fusion") if path not in inside]


def test_the_library_never_imports_the_service() -> None:
    assert violations(service_imports, sources("fusion")) == []


def test_the_library_reads_no_environment() -> None:
    assert violations(environment_reads, sources("fusion")) == []


def test_sql_stands_in_the_stores_only() -> None:
    assert violations(sql_statements, outside_the_stores()) == []
    # The declaration of the tables may name SQL functions and conditions: defaults, partial indexes.
    declared = set(Path("app/core/tables").glob("*.py"))
    assert violations(sql_builders, [path for path in outside_the_stores() if path not in declared]) == []


def test_no_setting_is_read_at_import() -> None:
    assert violations(settings_read_at_import, sources("app") + sources("migrations")) == []


@pytest.mark.parametrize(
    ("rule", "code"),
    [
        (service_imports, "import app"),
        (service_imports, "def f():\n    from app.core.settings import Settings"),
        (service_imports, "import importlib\nimportlib.import_module('app.drives')"),
        (environment_reads, "import os\nos.environ['X']"),
        (environment_reads, "from os import getenv as g"),
        (sql_builders, "from sqlalchemy import text"),
        (sql_builders, "from sqlalchemy.sql import select"),
        (sql_statements, "query = 'SELECT 1 FROM segments'"),
        (sql_statements, "query = f'''\n  DELETE FROM {table}'''"),
        (sql_statements, "connection.exec_driver_sql(query)"),
        (settings_read_at_import, "from app.core.settings import get_settings\nPORT = get_settings().port"),
    ],
)
def test_each_rule_sees_what_it_forbids(rule: Rule, code: str) -> None:
    assert list(rule(ast.parse(code)))


@pytest.mark.parametrize(
    ("rule", "code"),
    [
        (service_imports, "import application\nfrom . import app_like"),
        (sql_statements, "note = 'Select a method, or update the map'"),
        (sql_builders, "from sqlalchemy import create_engine"),
        (settings_read_at_import, "def f():\n    return get_settings()"),
    ],
)
def test_no_rule_sees_what_it_allows(rule: Rule, code: str) -> None:
    assert not list(rule(ast.parse(code)))


def repository_files() -> list[Path]:
    """What is committed or would be: tracked files, and new ones that .gitignore does not name."""
    command = [
        "git",
        "-c",
        f"safe.directory={REPOSITORY}",
        "ls-files",
        "--cached",
        "--others",
        "--exclude-standard",
    ]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        pytest.skip("this copy of the sources is no git repository, so stray files cannot be told apart")
    return [Path(line) for line in done.stdout.splitlines()]


def test_the_top_level_holds_only_what_belongs_there() -> None:
    top = {path.parts[0] for path in repository_files()}
    assert {name for name in top if not name.startswith(".")} <= TOP_LEVEL


@pytest.mark.parametrize(("lock", "extras"), [("runtime.txt", []), ("dev.txt", ["dev"])])
def test_the_lock_covers_every_dependency_and_names_no_address(lock: str, extras: list[str]) -> None:
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
    wanted = project["dependencies"] + [d for e in extras for d in project["optional-dependencies"][e]]
    text = (REPOSITORY / ".lock" / lock).read_text()
    locked = set(re.findall(r"^([a-z0-9.-]+)(?:\[[a-z0-9, -]+\])?==", text, flags=re.MULTILINE))
    names = {re.split(r"[\[><=~! ]", requirement)[0] for requirement in wanted}
    assert names - locked == set(), "run `make lock`"
    assert "://" not in text
