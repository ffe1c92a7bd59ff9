"""The logs that commands name: files, folders and zips sorted into drives, and the base beside them."""

from __future__ import annotations

import errno
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from app.cli.console import spoken
from app.core.messages import say
from fusion.errors import FusionError
from fusion.messages import message_of

if TYPE_CHECKING:
    from app.cli.console import Console
    from fusion.formats.container import Member
    from fusion.signals import RawGnss
    from fusion.types import DriveLog, Progress


@dataclass(frozen=True)
class LogFiles:
    """The files that belong to one drive, as they were named: files, or folders of files.

    ``members``: the files in them that this drive is made of, where they hold several drives. ``base``: see ``BASE``.
    """

    paths: tuple[Path, ...]
    members: tuple[Member, ...] = ()
    base: RawGnss | None = None

    @property
    def name(self) -> str:
        """What it is called: as it was named, several separated by commas."""
        named = ", ".join(map(str, self.paths))
        return f"{named}: {self.short_name}" if self.members else named

    @property
    def short_name(self) -> str:
        """The same without folders."""
        return ", ".join(one.name for one in (self.members or self.paths))

    @property
    def digests(self) -> list[str]:
        """SHA-256 of each file."""
        if self.members:
            return [hashlib.sha256(one.data).hexdigest() for one in self.members]
        return [_digest(path) for path in self.files()]

    def files(self) -> list[Path]:
        """The files themselves: in a folder those that are not hidden, by name, none of folders in it.

        Raises ``OSError`` for a folder that holds none.
        """
        return [file for path in self.paths for file in (_files_in(path) if path.is_dir() else [path])]

    def read(self, progress: Progress, columns: Mapping[str, str] | None = None) -> DriveLog:
        """The log of the drive; raises ``LogError`` or ``OSError``. ``columns`` as in ``fusion.formats.read_log``."""
        from fusion.formats import read_logs

        if self.members:
            names = [one.name for one in self.members]
            data = [one.data for one in self.members]
            log = read_logs(data, names=names, columns=columns, progress=progress)
        else:
            log = read_logs(self.files(), columns=columns, progress=progress)
        if self.base is None or log.raw is None:
            return log
        return replace(log, raw=log.raw.beside(self.base))


def base_of(paths: Sequence[Path] | None, place: str | None) -> RawGnss | None:
    """What ``--base`` and ``--base-place`` say; raises ``typer.BadParameter`` for what is of no use."""
    if not paths:
        if place is not None:
            raise typer.BadParameter(spoken(say("base.place_alone")), param_hint="--base-place")
        return None
    import numpy as np

    from fusion.gnss.earth import ecef
    from fusion.types import no_progress

    try:
        base = LogFiles(tuple(paths)).read(no_progress).raw
    except (FusionError, OSError) as error:
        why = say("base.unreadable", files=", ".join(map(str, paths)), why=message_of(error))
        raise typer.BadParameter(spoken(why), param_hint="--base") from error
    if base is None or not len(base.signals):
        raise typer.BadParameter(spoken(say("base.no_raw")), param_hint="--base")
    if place is None:
        return base
    try:
        lat_deg, lon_deg, height_m = (float(part) for part in place.split(","))
    except ValueError:
        raise typer.BadParameter(
            spoken(say("base.place_form", place=place)), param_hint="--base-place"
        ) from None
    return replace(base, place_m=ecef(np.array([lon_deg]), np.array([lat_deg]), np.array([height_m]))[0])


def drives_of(paths: Sequence[Path], together: bool, base: RawGnss | None = None) -> list[LogFiles]:
    """Each path a drive, or all of them one."""
    return [LogFiles(one, base=base) for one in ([tuple(paths)] if together else [(path,) for path in paths])]


def sorted_drives(
    paths: Sequence[Path],
    console: Console,
    *,
    together: bool,
    apart: bool,
    columns: Mapping[str, str] | None = None,
    base: RawGnss | None = None,
) -> list[LogFiles]:
    """Each path a drive, but a folder or a zip as many as are in it, which is said; or all of them one."""
    if together and apart:
        raise typer.BadParameter(spoken(say("options.contradict")), param_hint="'--apart'")
    drives = drives_of(paths, together, base)
    return drives if together else [one for named in drives for one in _in_it(named, console, apart, columns)]


def _in_it(
    named: LogFiles, console: Console, apart: bool, columns: Mapping[str, str] | None
) -> Sequence[LogFiles]:
    from fusion.formats import sort_files
    from fusion.formats.container import is_zip
    from fusion.formats.grouping import Rule

    try:
        files = named.files()
        with files[0].open("rb") as first:
            if len(files) == 1 and not is_zip(first.read(4)):
                return [named]
        found = sort_files(files, columns=columns, rule=Rule.APART if apart else Rule.AUTO)
    except (FusionError, OSError):
        return [named]  # whoever reads it says what is wrong
    for doubt in found.grouping.unclear:
        console.warn(named.name, [unclear_words([found.files[k].name for k in doubt.files], doubt.why)])
    if len(found.grouping.drives) < 2:
        return [named]
    console.note(say("logs.drives", name=named.name, n=len(found.grouping.drives)))
    console.warn(
        named.name, (say("logs.left_out", name=name, reason=reason) for name, reason in found.left_out)
    )
    return [replace(named, members=tuple(found.files[k] for k in drive)) for drive in found.grouping.drives]


def unclear_words(files: Sequence[str], why: str) -> str:
    """What is said of files that were taken for one drive and could be several."""
    reason = "go on where the one before ended" if why == "continues" else "have positions of the same time"
    return say("logs.unclear", files=", ".join(files), why=reason)


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _files_in(folder: Path) -> list[Path]:
    files = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    if not files:
        raise FileNotFoundError(errno.ENOENT, "The folder holds no file", str(folder))
    return files
