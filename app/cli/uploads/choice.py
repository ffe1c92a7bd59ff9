"""What the options of ``versant upload`` say of archives, and what is one. Loads no format: most uploads are none."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.cli.console import spoken
from app.core.messages import say

if TYPE_CHECKING:
    from fusion.formats.archives.look import Looker

ONE_UPLOAD_FILES = 32
"""A folder or a zip of more files, or of zips, is no single upload (a test holds it equal to the service's own)."""
_ZIP = b"PK\x03\x04"


@dataclass(frozen=True)
class ArchiveChoice:
    """What the options say of archives."""

    every_sport: bool = False
    sports: Sequence[str] | None = None
    manifest: Path | None = None
    dry_run: bool = False
    journal: Path | None = None

    @property
    def is_made(self) -> bool:
        """Whether one of them is given: then all that is named is looked at as an archive."""
        return self != ArchiveChoice()

    def looker(self, columns: Mapping[str, str]) -> Looker:
        """How files are looked at; raises ``typer.BadParameter`` for a sport that nobody knows."""
        from fusion.formats.archives.look import Looker
        from fusion.formats.archives.sports import ON_ROADS

        if self.every_sport:
            return Looker(None, columns)
        return Looker(asked_sports(self.sports) if self.sports else ON_ROADS, columns)


def asked_sports(names: Sequence[str]) -> frozenset[str]:
    """What ``--sports`` names; raises ``typer.BadParameter`` for a sport that nobody knows."""
    from fusion.formats.archives.sports import ROADS, SPORTS, chosen

    try:
        return chosen(names)
    except ValueError as error:
        known = ", ".join(spoken(one) for one in (ROADS, *SPORTS))
        raise typer.BadParameter(
            spoken(say("options.no_sport", name=str(error), known=known)), param_hint="'--sports'"
        ) from error


def is_archive(path: Path) -> bool:
    """Whether a folder or a zip holds more than one upload can: many files, zips, or files in its folders alone."""
    try:
        if path.is_dir():
            return _is_archive_folder(path)
        with path.open("rb") as file:
            if file.read(len(_ZIP)) != _ZIP:
                return False
        with zipfile.ZipFile(path) as archive:
            names = [one.filename.lower() for one in archive.infolist() if not one.is_dir()]
        return len(names) > ONE_UPLOAD_FILES or any(name.endswith(".zip") for name in names)
    except (zipfile.BadZipFile, ValueError, NotImplementedError, RuntimeError, OSError):
        return False  # whoever sends it says what is wrong


def _is_archive_folder(folder: Path) -> bool:
    count, has_own = 0, False
    for path in folder.rglob("*"):
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(folder).parts):
            count, has_own = count + 1, has_own or path.parent == folder
            if count > ONE_UPLOAD_FILES or path.suffix.lower() == ".zip":
                return True
    return count > 0 and not has_own
