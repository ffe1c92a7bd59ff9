"""SUMO's programs, where they are: in ``SUMO_HOME``, as they say themselves, or on the path."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest


def sumo_program(name: str) -> str:
    """The program's file; the test is skipped, saying why, where it is not installed."""
    home = os.environ.get("SUMO_HOME")
    found = shutil.which(name, path=str(Path(home) / "bin")) if home else shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not installed: set SUMO_HOME to the folder of an eclipse-sumo package")
    return found


def run(*command: object, folder: Path) -> str:
    """Run a program in a folder; what it says on both channels."""
    done = subprocess.run(
        [str(part) for part in command], cwd=folder, capture_output=True, text=True, check=False, timeout=120
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    return said
