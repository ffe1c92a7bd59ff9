"""What is installed from a wheel serves the pages; npm and what it needs are neither in it nor asked for."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from zipfile import ZipFile

import pytest

from source_tree import REPOSITORY

LEAST_SETUPTOOLS = 77
PARTS = ("pyproject.toml", "README.md", "LICENSE", "docs", "app", "fusion", "migrations")
BUILD = "import sys; from setuptools import build_meta; build_meta.build_{}(sys.argv[1])"
SERVE = """
import sys, app
from fastapi.testclient import TestClient
from app.core.settings import Settings
from app.main import create_app

assert app.__file__.startswith(sys.argv[1]), app.__file__
settings = Settings(database_url="postgresql://nobody@127.0.0.1:9/none", data_dir=sys.argv[2])
with TestClient(create_app(settings), base_url="http://127.0.0.1") as client:
    for path in ("/map", "/docs", "/docs/recording", "/"):
        answer = client.get(path, headers={"Accept": "text/html"})
        assert answer.status_code == 200, (path, answer.text)
    page = client.get("/map").text
    for name in (part.split('"')[0] for part in page.split('src="')[1:]):
        assert client.get(name).status_code == 200, name
"""


def run(code: str, *arguments: Path, cwd: Path, path: Path | None = None) -> None:
    environment = {"PATH": "", "PYTHONPATH": str(path or ""), "HOME": str(cwd)}
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", code, *map(str, arguments)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def builder() -> Path:
    """Where setuptools is."""
    try:
        found = version("setuptools")
    except PackageNotFoundError:
        found = "0"
    if int(found.partition(".")[0]) < LEAST_SETUPTOOLS:
        pytest.skip(f"setuptools {found} builds no wheel of this project: `make setup` installs a newer one.")
    import setuptools  # noqa: PLC0415 - only where it is new enough

    return Path(setuptools.__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built from a source archive, which is built from the sources: as installers do."""
    tools = builder()
    if not (REPOSITORY / "app" / "web" / "built" / "map.html").is_file():
        pytest.fail("the pages are not built; run: make web")
    folder = tmp_path_factory.mktemp("package")
    sources = folder / "sources"
    sources.mkdir()
    ignored = shutil.ignore_patterns("node_modules", "__pycache__")
    for name in PARTS:
        place = REPOSITORY / name
        if place.is_dir():
            shutil.copytree(place, sources / name, ignore=ignored)
        else:
            shutil.copy(place, sources)
    module = sources / "app" / "web" / "node_modules" / "gyp"
    module.mkdir(parents=True)
    for name in ("index.js", "__init__.py"):
        (module / name).touch()
    run(BUILD.format("sdist"), folder, cwd=sources, path=tools)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as packed:
        packed.extractall(folder, filter="data")
    run(BUILD.format("wheel"), folder, cwd=folder / archive.name.removesuffix(".tar.gz"), path=tools)
    (made,) = folder.glob("*.whl")
    return made


def test_a_wheel_holds_the_pages_and_not_how_they_are_made(wheel: Path) -> None:
    with ZipFile(wheel) as packed:
        names = set(packed.namelist())
    built = REPOSITORY / "app" / "web" / "built"
    there = {
        f"app/web/built/{path.relative_to(built).as_posix()}" for path in built.rglob("*") if path.is_file()
    }
    assert {name for name in names if name.startswith("app/web/built/")} == there
    assert [name for name in names if name.startswith(("app/web/src/", "app/web/plugins/"))] == []
    assert [name for name in names if "node_modules" in name or name.endswith((".ts", ".tsx"))] == []
    assert "app/map/items/templates/plain.css" in names
    assert {f"app/exports/qgis/plugin/{name}" for name in ("__init__.py", "icon.svg")} <= names


def test_what_is_installed_serves_the_pages(wheel: Path, tmp_path: Path) -> None:
    place = tmp_path / "installed"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", "--no-compile"]
    subprocess.run([*install, "--target", str(place), str(wheel)], check=True, capture_output=True)
    run(SERVE, place, tmp_path, cwd=tmp_path, path=place)
