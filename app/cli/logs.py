"""What a command calls a log: a file, or the files of one drive, named together, in a folder or in a zip."""

from __future__ import annotations

import errno
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from fusion.types import DriveLog, Progress

LogNames = Annotated[
    list[Path],
    typer.Argument(
        metavar="LOG...",
        help="Drive logs, gzipped or not; a folder or a zip is one drive of the files in it.",
    ),
]
Together = Annotated[
    bool,
    typer.Option("--together", help="All of them are one drive, such as observations and navigation."),
]


@dataclass(frozen=True)
class LogFiles:
    """The files that belong to one drive, as they were named: files, or folders of files."""

    paths: tuple[Path, ...]

    @property
    def name(self) -> str:
        """What it is called: as it was named, several separated by commas."""
        return ", ".join(map(str, self.paths))

    @property
    def short_name(self) -> str:
        """The same without folders."""
        return ", ".join(path.name for path in self.paths)

    def files(self) -> list[Path]:
        """The files themselves: in a folder those that are not hidden, by name, none of folders in it.

        Raises ``OSError`` for a folder that holds none.
        """
        return [file for path in self.paths for file in (_files_in(path) if path.is_dir() else [path])]

    def read(self, progress: Progress, columns: Mapping[str, str] | None = None) -> DriveLog:
        """The log of the drive; raises ``LogError`` or ``OSError``. ``columns`` as in ``fusion.formats.read_log``."""
        from fusion.formats import read_logs  # noqa: PLC0415 - see app.cli

        return read_logs(self.files(), columns=columns, progress=progress)


def drives_of(paths: Sequence[Path], together: bool) -> list[LogFiles]:
    """Each path a drive, or all of them one."""
    return [LogFiles(tuple(paths))] if together else [LogFiles((path,)) for path in paths]


def _files_in(folder: Path) -> list[Path]:
    found = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    if not found:
        raise FileNotFoundError(errno.ENOENT, "The folder holds no file", str(folder))
    return found
