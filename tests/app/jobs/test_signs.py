"""Which processes of the machine live: the kernel says it, whatever became of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from app.core.claims import process_name
from app.jobs import computations as files
from app.jobs.computations import FORGOTTEN_AFTER_S, Signs

REPOSITORY = Path(__file__).resolve().parents[3]
_PROGRAM = """
import sys, time
from pathlib import Path
from app.core.claims import process_name
from app.jobs.computations import Signs
signs = Signs(Path(sys.argv[1]))
signs.begin()
if sys.argv[2] == "ends":
    signs.end()
print(process_name(), flush=True)
time.sleep(600)
"""


@contextmanager
def process(folder: Path, does: str = "lives") -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process with a sign, and its name; killed at the end of the block."""
    command = [sys.executable, "-c", _PROGRAM, str(folder), does]
    with subprocess.Popen(command, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) as one:
        assert one.stdout is not None
        name = one.stdout.readline().strip()
        try:
            yield one, name
        finally:
            one.kill()


def died(folder: Path) -> list[str]:
    with Signs(folder).died() as names:
        return names


def test_who_was_killed_is_told_of_once(tmp_path: Path) -> None:
    with process(tmp_path) as (one, name):
        assert died(tmp_path) == []
        one.send_signal(signal.SIGSTOP)
        assert died(tmp_path) == [], "it is only paused"
        one.kill()
        one.wait()
        assert died(tmp_path) == [name]
    assert died(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_it_is_told_again_where_nothing_came_of_it(tmp_path: Path) -> None:
    with process(tmp_path) as (one, name):
        one.kill()
        one.wait()
        with pytest.raises(ZeroDivisionError), Signs(tmp_path).died() as names:
            assert names == [name]
            assert died(tmp_path) == [], "one at a time is told"
            raise ZeroDivisionError
        assert died(tmp_path) == [name]


def test_who_ends_in_order_did_not_die(tmp_path: Path) -> None:
    with process(tmp_path, "ends") as (one, _):
        one.kill()
        one.wait()
        assert died(tmp_path) == []


def test_a_machine_that_went_is_nobodys_death(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with process(tmp_path) as (one, _):
        one.kill()
        one.wait()
    monkeypatch.setattr(files, "_boot", lambda: "another")
    assert died(tmp_path) == []
    (left,) = tmp_path.iterdir()
    old_s = time.time() - FORGOTTEN_AFTER_S - 1
    os.utime(left, (old_s, old_s))
    assert died(tmp_path) == []
    assert list(tmp_path.iterdir()) == []


def test_a_fork_has_a_name_of_its_own() -> None:
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.write(writing, process_name().encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(reading, 1000).decode() != process_name()
    assert process_name() == process_name()


def test_a_folder_that_cannot_be_written_stops_nobody(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").touch()
    signs = Signs(tmp_path / "file")
    signs.begin()
    assert "nobody will know" in caplog.text
    assert died(tmp_path / "file") == []
    signs.end()
