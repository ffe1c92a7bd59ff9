"""Machine code on disk: kept while nothing changes that it was made from, thrown away when anything does."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from numba.core import caching

from fusion.compiled import compiled, content_stamp

KERNEL = """
from kept.callee import (
    step,
)
from fusion.compiled import {decorator}

@{decorator}
def total(n):
    s = 0.0
    for k in range(n):
        s += step(k)
    return s
"""
CALLEE = """
from fusion.compiled import compiled
from kept import constants

FACTOR = constants.FACTOR

@compiled
def step(k):
    return FACTOR * k
"""
RUN = "from kept.kernel import total; print(total(4), sum(total.stats.cache_hits.values()))"


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """A package whose kernel calls a callee in a second file, which takes a constant from a third."""
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "constants.py").write_text("FACTOR = 1.0\n")
    (folder / "callee.py").write_text(CALLEE)
    (folder / "kernel.py").write_text(KERNEL.format(decorator="compiled"))
    return folder


def run(package: Path, what: str = RUN) -> tuple[float, int]:
    """What the kernel says in a process of its own, and how many functions came from the cache."""
    places = [str(package.parent), *sys.path]
    code = f"import sys; sys.path[:] = {places!r}; {what}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    total, hits = done.stdout.split()
    return float(total), int(hits)


@pytest.mark.slow
def test_an_edited_callee_is_compiled_into_its_caller_again(package: Path) -> None:
    assert run(package) == (6.0, 0)
    assert run(package) == (6.0, 1)  # nothing changed: from the cache
    callee = package / "callee.py"
    callee.write_text(callee.read_text().replace("FACTOR * k", "FACTOR * k + 100.0"))
    assert run(package) == (406.0, 0)
    assert run(package) == (406.0, 1)


@pytest.mark.slow
def test_an_edited_constant_two_files_away_counts(package: Path) -> None:
    assert run(package)[0] == 6.0
    (package / "constants.py").write_text("FACTOR = 10.0\n")
    assert run(package) == (60.0, 0)


@pytest.mark.slow
@pytest.mark.parametrize("decorator", ["compiled_vector", "compiled_parallel"])
def test_every_decorator_keeps_the_rule(package: Path, decorator: str) -> None:
    (package / "kernel.py").write_text(KERNEL.format(decorator=decorator))
    assert run(package)[0] == 6.0
    (package / "constants.py").write_text("FACTOR = 10.0\n")
    assert run(package) == (60.0, 0)
    assert run(package) == (60.0, 1)


@pytest.mark.slow
def test_a_class_that_has_moved_since_is_no_trouble(package: Path) -> None:
    """The old machine code names the class's old module, which is gone."""
    box = "from typing import NamedTuple\nclass Box(NamedTuple):\n    n: int\n"
    kernel = KERNEL.format(decorator="compiled").replace("range(n)", "range(n.n)")
    run_box = "from kept.kernel import total, Box; print(total(Box(4)), sum(total.stats.cache_hits.values()))"
    for module in ("shape", "form"):
        (package / f"{module}.py").write_text(box)
        (package / "kernel.py").write_text(f"from kept.{module} import Box\n{kernel}")
        assert run(package, run_box) == (6.0, 0)
        assert run(package, run_box) == (6.0, 1)
        (package / f"{module}.py").unlink()


@pytest.mark.slow
def test_superseded_machine_code_is_removed(package: Path) -> None:
    run(package)
    before = sorted(path.name for path in (package / "__pycache__").glob("*.nb[ic]"))
    (package / "constants.py").write_text("FACTOR = 10.0\n")
    run(package)
    after = sorted(path.name for path in (package / "__pycache__").glob("*.nb[ic]"))
    assert len(after) == len(before) == 4  # an index and the code of each function
    assert not set(before) & set(after)


@pytest.mark.slow
def test_a_file_that_nobody_imports_changes_nothing(package: Path) -> None:
    assert run(package) == (6.0, 0)
    (package / "other.py").write_text("from kept.kernel import total\n")
    assert run(package) == (6.0, 1)


@pytest.mark.parametrize(
    "line",
    [
        "import kept.constants",
        "from kept import constants as c",
        "from kept.constants import FACTOR",
        "from kept import (\n    other,\n    constants,\n)",
        "def f():\n    from kept.constants import FACTOR",
    ],
)
def test_every_way_of_importing_is_seen(tmp_path: Path, line: str) -> None:
    stamps = []
    for factor in (1, 2):
        folder = tmp_path / str(factor) / "kept"
        folder.mkdir(parents=True)
        (folder / "__init__.py").write_text("")
        (folder / "constants.py").write_text(f"FACTOR = {factor}\n")
        (folder / "user.py").write_text(f"{line}\n")
        stamps.append(content_stamp(folder / "user.py"))
    assert stamps[0] != stamps[1]


def test_a_circle_of_imports_ends(tmp_path: Path) -> None:
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / "__init__.py").write_text("")
    (folder / "a.py").write_text("from kept.b import B\n")
    (folder / "b.py").write_text("from kept.a import A\n")
    assert content_stamp(folder / "a.py") == content_stamp(folder / "b.py")


def test_a_file_outside_any_package_stands_for_itself(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text("import kept.constants\n")
    assert len(content_stamp(script)) == 64


NOWHERE = "import tempfile; tempfile.TemporaryFile = lambda **_: (_ for _ in ()).throw(OSError()); "


@pytest.mark.slow
def test_a_folder_that_cannot_be_written_to_serves_those_who_read_it(package: Path) -> None:
    """As a read-only container finds it; an empty one is no use, and what cannot be kept is compiled all the same."""
    assert run(package, NOWHERE + RUN) == (6.0, 0)
    assert not list(package.rglob("*.nbi"))
    assert run(package) == (6.0, 0)
    assert run(package, NOWHERE + RUN) == (6.0, 1)


def test_two_that_keep_machine_code_at_once_keep_both(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of two signatures of one function: numba alone would write both into one file."""

    def twice(x: Any) -> Any:
        return x + x

    def look_together(file: Any) -> Any:
        found = look(file)
        with suppress(threading.BrokenBarrierError):
            both_looked.wait(timeout=0.3)
        return found

    def keep(loop: Any) -> None:
        ((signature, code),) = loop.overloads.items()
        loop._cache.save_overload(signature, code)

    monkeypatch.setattr(caching.config, "CACHE_DIR", str(tmp_path))
    loops: list[Callable[..., Any]] = [compiled(twice), compiled(twice)]
    assert (loops[0](1), loops[1](1.5)) == (2, 3.0)
    for file in tmp_path.rglob("*.nb[ic]"):
        file.unlink()
    look, both_looked = caching.IndexDataCacheFile._load_index, threading.Barrier(2)
    monkeypatch.setattr(caching.IndexDataCacheFile, "_load_index", look_together)
    with ThreadPoolExecutor(2) as threads:
        list(threads.map(keep, loops))
    monkeypatch.undo()
    kept = look(loops[0]._cache._cache_file)  # type: ignore[attr-defined]
    assert len(set(kept.values())) == len(loops)
