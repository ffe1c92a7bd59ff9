"""Reads ``postmaster.pid``, and distinguishes a running server from the remains of a crash."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from app.embedded.binaries import output


@dataclass(frozen=True)
class Postmaster:
    """The living server process of one data folder."""

    pid: int
    socket_dir: Path
    ready: bool


def running_postmaster(data: Path) -> Postmaster | None:
    """The server that runs on ``data`` now, or None.

    The file alone proves nothing: after a crash or a reboot its pid may be free, or belong to any other
    program. Only a process that works in this very folder counts.
    """
    try:
        lines = (data / "postmaster.pid").read_text(errors="replace").splitlines()
        pid = int(lines[0])
    except (OSError, ValueError, IndexError):
        return None
    if not _serves(pid, data):
        return None
    # Lines 5 and 8 (socket folder, state) are written as the server comes up.
    socket_dir = Path(lines[4]) if len(lines) > 4 else Path()
    ready = len(lines) > 7 and lines[7].strip() == "ready"
    return Postmaster(pid, socket_dir, ready)


def _serves(pid: int, data: Path) -> bool:
    if pid <= 0 or not _alive(pid):
        return False
    proc = Path("/proc") / str(pid)
    if Path("/proc/self/cwd").exists():
        try:
            # PostgreSQL's processes work in the data folder; the link is dead for one that has exited.
            return (proc / "cwd").samefile(data) and (proc / "comm").read_text().startswith(
                ("postgres", "postmaster")
            )
        except OSError:
            return False
    return _is_postgres(pid)


def _alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def _is_postgres(pid: int) -> bool:
    """For systems without /proc, where a process's folder is hard to come by: is it a PostgreSQL at all?"""
    return Path(output("ps", "-o", "comm=", "-p", str(pid))).name in {"postgres", "postmaster"}
