"""What is built comes from the sources as they are, and nobody edited it.

Sources and built files are compared with ``sources.json``, which the build wrote; no npm is needed for that. Where npm
and its packages are there, the pages are built anew and compared byte for byte.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from hashlib import sha256
from pathlib import Path

import pytest

from source_tree import REPOSITORY

WEB = REPOSITORY / "app" / "web"
BUILT = WEB / "built"
MANIFEST = "sources.json"
RENEW = "run: make web"


def digest(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def below(folder: Path) -> set[Path]:
    return {path for path in folder.rglob("*") if path.is_file()}


def sources() -> set[Path]:
    """What the build reads: the pages, and how they are built."""
    pages = {path for path in below(WEB / "src") if not re.search(r"\.test\.tsx?$", path.name)}
    pages = {path for path in pages if "node_modules" not in path.parts}  # what tools keep for themselves
    pages -= below(WEB / "src" / "api")  # made from the API's description, and gone after the build
    names = ("package.json", "package-lock.json", "tsconfig.json", "vite.config.ts")
    folders = (REPOSITORY / "fusion" / "catalogues", REPOSITORY / "app" / "core" / "messages")
    catalogues = {folder / f"{language}.json" for folder in folders for language in ("en", "de")}
    return pages | catalogues | below(WEB / "plugins") | {WEB / name for name in names}


@pytest.fixture(scope="module")
def manifest() -> dict[str, dict[str, str]]:
    assert (BUILT / MANIFEST).is_file(), f"the pages are not built; {RENEW}"
    found: dict[str, dict[str, str]] = json.loads((BUILT / MANIFEST).read_text(encoding="utf-8"))
    return found


def differing(told: dict[str, str], here: dict[str, str]) -> dict[str, str]:
    """Name -> what is the matter with it."""
    return {
        name: "new" if name not in told else "gone" if name not in here else "changed"
        for name in sorted(told.keys() | here.keys())
        if told.get(name) != here.get(name)
    }


def test_pages_are_built_from_the_sources_of_today(manifest: dict[str, dict[str, str]]) -> None:
    today = {path.relative_to(REPOSITORY).as_posix(): digest(path) for path in sources()}
    assert differing(manifest["sources"], today) == {}, RENEW


def test_nothing_built_was_edited_added_or_lost(manifest: dict[str, dict[str, str]]) -> None:
    there = {path.relative_to(BUILT).as_posix(): digest(path) for path in below(BUILT)}
    there.pop(MANIFEST)
    assert differing(manifest["built"], there) == {}, RENEW


def test_a_difference_is_named() -> None:
    assert differing({"a": "1", "b": "1", "c": "1"}, {"a": "1", "b": "2", "d": "1"}) == {
        "b": "changed",
        "c": "gone",
        "d": "new",
    }


def test_nothing_built_names_this_machine(manifest: dict[str, dict[str, str]]) -> None:
    here = str(REPOSITORY).encode()
    assert [name for name in manifest["built"] if here in (BUILT / name).read_bytes()] == []


def test_building_anew_gives_the_same_bytes(manifest: dict[str, dict[str, str]], tmp_path: Path) -> None:
    node, vite = shutil.which("node"), WEB / "node_modules" / "vite" / "bin" / "vite.js"
    if node is None or not vite.is_file():
        pytest.skip("npm's packages are missing: `make web` installs them where npm is.")
    done = subprocess.run(
        [
            node,
            str(vite),
            "build",
            "--outDir",
            str(tmp_path / "built"),
            "--emptyOutDir",
            "--logLevel",
            "error",
        ],
        cwd=WEB,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    anew = {path.relative_to(tmp_path / "built").as_posix(): path for path in below(tmp_path / "built")}
    assert sorted(anew) == sorted([*manifest["built"], MANIFEST])
    assert [name for name, path in anew.items() if path.read_bytes() != (BUILT / name).read_bytes()] == []
