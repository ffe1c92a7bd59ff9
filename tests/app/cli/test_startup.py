"""The command line answers at once: describing a command loads nothing that only running it needs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from typing import Any

import pytest

from app.cli import COMMANDS

HEAVY = (
    "alembic", "app.core.settings", "app.main", "fastapi", "fsspec", "fusion.types", "geopandas", "httpx", "matplotlib",
    "numba", "numpy", "osmium", "pandas", "procrastinate", "psycopg", "pyarrow", "pydantic_settings", "pyogrio",
    "pyproj", "rasterio", "scipy", "shapely", "sqlalchemy", "starlette", "uvicorn",
)  # fmt: skip

LOADED = """
import contextlib, io, json, sys
from app.cli import app
for arguments in json.loads(sys.argv[1]):
    with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):
        app(arguments, prog_name="versant")
print(json.dumps(sorted(sys.modules)))
"""


def loaded_by(*command_lines: list[str]) -> set[str]:
    """The modules that a fresh process has loaded after these command lines, one after the other."""
    done = subprocess.run(
        [sys.executable, "-c", LOADED, json.dumps(command_lines)],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    modules: list[Any] = json.loads(done.stdout)
    return set(modules)


@pytest.mark.parametrize("arguments", [[], ["--help"], ["--version"], ["nonsense"]], ids=str)
def test_the_command_line_itself_loads_no_command(arguments: list[str]) -> None:
    loaded = loaded_by(arguments)
    assert "app.cli" in loaded
    assert loaded.isdisjoint({command.module for command in COMMANDS.values()} | set(HEAVY))


def test_the_help_of_a_command_loads_nothing_that_only_running_it_needs() -> None:
    loaded = loaded_by(*([name, "--help"] for name in COMMANDS))
    assert loaded >= {command.module for command in COMMANDS.values()}
    assert loaded.isdisjoint(HEAVY)


def test_a_client_of_the_service_loads_no_library_of_estimation() -> None:
    loaded = loaded_by(["upload", "none.csv", "--server", "http://127.0.0.1:9"])
    assert "httpx" in loaded
    assert loaded.isdisjoint(
        {"fastapi", "fusion.pipeline", "numba", "numpy", "rasterio", "scipy", "sqlalchemy"}
    )


@pytest.mark.slow
def test_what_can_be_chosen_is_listed_without_the_service() -> None:
    loaded = loaded_by(["methods"])
    assert "fusion.methods" in loaded
    assert loaded.isdisjoint({"fastapi", "httpx", "matplotlib", "procrastinate", "psycopg", "sqlalchemy"})


IMPORTED = """
import importlib, json, sys
importlib.import_module(sys.argv[1])
print(json.dumps(sorted(sys.modules)))
"""


@pytest.mark.slow
@pytest.mark.parametrize("program", ["app.main", "app.drives.batches.enqueuing"])
def test_who_serves_and_who_enqueues_load_no_estimator(program: str) -> None:
    """Compilers and solvers took half of the memory of the API, which computes nothing."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED, program],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    loaded = set(json.loads(done.stdout))
    assert program in loaded
    assert loaded.isdisjoint(
        {
            "fusion.pipeline",
            "fusion.methods",
            "geopandas",
            "matplotlib",
            "numba",
            "osmium",
            "pandas",
            "rasterio",
            "scipy",
        }
    )


@pytest.mark.slow
def test_who_draws_loads_neither_web_nor_database() -> None:
    done = subprocess.run(
        [sys.executable, "-c", IMPORTED, "app.drives.outputs.profile_picture"],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert set(json.loads(done.stdout)).isdisjoint({"fastapi", "psycopg", "scipy", "sqlalchemy", "typer"})
