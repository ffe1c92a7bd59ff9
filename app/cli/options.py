"""Arguments and options that several commands share, and the logs that they name."""

from __future__ import annotations

import errno
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from fusion.errors import BadOptionsError, FusionError, UnknownNameError
from fusion.registry import check_columns
from fusion.types import no_progress

if TYPE_CHECKING:
    from app.cli.console import Console
    from app.core.db import Bounds
    from fusion.formats.container import Member
    from fusion.methods.base import Options
    from fusion.signals import RawGnss
    from fusion.types import DriveLog, Progress


def in_a_folder(path: Path | None) -> Path | None:
    """Callback of an option that names a file to write: refuses it now if its folder is missing."""
    if path is not None and not path.parent.is_dir():
        raise typer.BadParameter(f"{path} cannot be written: there is no folder {path.parent}.")
    return path


def opt(help: str, *flags: str, default: Any = None, **more: Any) -> Any:  # noqa: A002 - typer's name
    """An option of one command, as its parameter's default value; ``...`` as ``default``: it must be given."""
    return typer.Option(default, *flags, help=help, **more)


def flag(help: str, *flags: str, **more: Any) -> Any:  # noqa: A002
    """An option that is there or not."""
    return typer.Option(False, *flags, help=help, **more)


def arg(help: str, *, default: Any = ..., **more: Any) -> Any:  # noqa: A002
    """An argument of one command, which must be given unless it has a default value."""
    return typer.Argument(default, help=help, **more)


def written_file(*flags: str, help: str, **more: Any) -> Any:  # noqa: A002
    """An option that names a file to write."""
    return opt(help, *flags, callback=in_a_folder, show_default=False, **more)


def gnss_name(default: str) -> Any:
    """The option that names a positioning."""
    help_ = "How positions are computed; `versant methods` lists the ways."
    return opt(help_, "--gnss", default=default, metavar="NAME")


DATA_DIR = opt(
    "Folder of the embedded database, started if it is not running. Default: VERSANT_DATABASE_URL, "
    "else the folder that `versant up` uses.",
    "--data-dir",
    metavar="DIR",
    file_okay=False,
)
JSON_FILE = written_file("--json", help="Write the figures as JSON as well.", metavar="FILE")
MAP_FILE = written_file("--map", help="Map of the slopes: .png, .pdf or .svg.", metavar="FILE")
MAP_SCALE = opt(
    "Steepness from which on the map is darkest; so that maps can be compared. Default: as suits the slopes.",
    "--scale",
    metavar="PERCENT",
    min=0.5,
    max=100,
)
GAPS = flag("Give undriven segments between driven ones a slope as well.", "--gaps")
ROADS = opt("OpenStreetMap roads: .osm, .osm.gz, .osm.pbf.", "--roads", default=..., metavar="FILE")
CONTROL = opt(
    "Surveyed heights: lat_deg, lon_deg, height_m, sigma_m (0.1 where not stated), above the logs' datum.",
    "--control",
    metavar="FILE.csv",
)
METHOD_OPTION = opt("Option of the method; may be given several times.", "--option", metavar="NAME=VALUE")
BASE = opt(
    "Log of a receiver whose place is known, near the drive and at its time, such as RINEX of a reference station: "
    "pseudoranges are corrected by it. Given again: its navigation file.",
    "--base",
    metavar="FILE",
)
BASE_PLACE = opt(
    "Where the base's antenna stands: degrees and metres above the ellipsoid. Default: as its file says.",
    "--base-place",
    metavar="LAT,LON,HEIGHT",
)
LOG_NAMES = arg(
    "Drive logs, gzipped or not. Of a folder or a zip those files are one drive that belong together, as observations "
    "and navigation do; others are drives of their own.",
    metavar="LOG...",
)
TOGETHER = flag("All of them are one drive, such as observations and navigation.", "--together")
APART = flag(
    "Of files in a folder or a zip that could be one drive or several, make several: parts that a recorder began one "
    "after the other, or two devices at once.",
    "--apart",
)
GNSS_OPTION = opt(
    "Option of the positioning; may be given several times.", "--gnss-option", metavar="NAME=VALUE"
)
COLUMNS_OPTION = opt(
    "A column of a CSV that is called otherwise, such as alt_msl_m=Altitude; may be given several times.",
    "--columns",
    metavar="NAME=HEADER",
)


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
    """What ``BASE`` and ``BASE_PLACE`` say; raises ``typer.BadParameter`` for what is of no use."""
    if not paths:
        if place is not None:
            raise typer.BadParameter(
                "it is the place of a base, and no --base is given.", param_hint="--base-place"
            )
        return None
    import numpy as np

    from fusion.gnss.earth import ecef

    try:
        base = LogFiles(tuple(paths)).read(no_progress).raw
    except (FusionError, OSError) as error:
        raise typer.BadParameter(f"{', '.join(map(str, paths))}: {error}", param_hint="--base") from error
    if base is None or not len(base.signals):
        raise typer.BadParameter("the file holds no pseudoranges.", param_hint="--base")
    if place is None:
        return base
    try:
        lat_deg, lon_deg, height_m = (float(part) for part in place.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"{place!r} is not LAT,LON,HEIGHT, such as 49.0112,8.4112,163.4.", param_hint="--base-place"
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
        raise typer.BadParameter("--together and --apart contradict each other.", param_hint="'--apart'")
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
    console.note(f"{named.name}: {len(found.grouping.drives)} drives.")
    console.warn(named.name, (f"{name} was left out. {reason}" for name, reason in found.left_out))
    return [replace(named, members=tuple(found.files[k] for k in drive)) for drive in found.grouping.drives]


def unclear_words(files: Sequence[str], why: str) -> str:
    """What is said of files that were taken for one drive and could be several."""
    reason = "go on where the one before ended" if why == "continues" else "have positions of the same time"
    return (
        f"{', '.join(files)} {reason}, and are taken for one drive. If they are several, say --apart; --together ends "
        "the doubt."
    )


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _files_in(folder: Path) -> list[Path]:
    files = sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith("."))
    if not files:
        raise FileNotFoundError(errno.ENOENT, "The folder holds no file", str(folder))
    return files


def parse_box(text: str | None) -> Bounds | None:
    """``WEST,SOUTH,EAST,NORTH`` in degrees; raises ``typer.BadParameter``."""
    if text is None:
        return None
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is not WEST,SOUTH,EAST,NORTH in degrees, such as 8.46,48.95,8.50,48.99.",
            param_hint="'--bbox'",
        ) from None
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise typer.BadParameter(
            f"{text!r} must have WEST < EAST within ±180 and SOUTH < NORTH within ±90.", param_hint="'--bbox'"
        )
    return west, south, east, north


@contextmanager
def naming(option: str) -> Iterator[None]:
    """Refuse as wrong usage, and name the option at fault, what the library refuses inside."""
    try:
        yield
    except (UnknownNameError, BadOptionsError) as error:
        raise typer.BadParameter(str(error), param_hint=f"'{option}'") from error


def _pairs(texts: Sequence[str] | None, option: str, form: str) -> Iterator[tuple[str, str]]:
    """The two sides of ``name=value`` each; ``typer.BadParameter`` says which ``form`` is wanted."""
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise typer.BadParameter(f"{text!r} is not {form}.", param_hint=f"'{option}'")
        yield name, value


def parse_columns(texts: Sequence[str] | None) -> dict[str, str]:
    """``name=header`` each, a column of ours and what it is called; raises ``typer.BadParameter``."""
    pairs = _pairs(texts, "--columns", "NAME=HEADER, such as alt_msl_m=Altitude")
    columns = {name.strip(): header.strip() for name, header in pairs}
    with naming("--columns"):
        check_columns(columns)
    return columns


def parse_assignments(texts: Sequence[str] | None, option: str) -> dict[str, Any]:
    """``name=value`` each: numbers, true and false as such, else text; raises ``typer.BadParameter``."""
    options: dict[str, Any] = {}
    form = "NAME=VALUE, such as particles=20000; `versant methods` lists the names"
    for name, value in _pairs(texts, option, form):
        try:
            options[name] = json.loads(value)
        except ValueError:
            options[name] = value
    return options


def positioning_options(gnss: str, texts: Sequence[str] | None) -> dict[str, Any]:
    """The options of the positioning ``gnss``; a name or a value that it does not take is wrong usage."""
    from fusion.catalogue import POSITIONINGS
    from fusion.gnss.positioning import options_of

    options = parse_assignments(texts, "--gnss-option")
    with naming("--gnss"):
        positioning = POSITIONINGS[gnss]
    with naming("--gnss-option"):
        options_of(positioning, options)
    return options


def usable_options(
    method: str,
    columns: Mapping[str, str],
    texts: Sequence[str] | None,
    gnss: str,
    gnss_texts: Sequence[str] | None,
) -> Options:
    """The options of a method, checked before the work starts; a wrong name is wrong usage."""
    from fusion.catalogue import METHODS
    from fusion.pipeline import parse_options

    options = ({"columns": columns} if columns else {}) | parse_assignments(texts, "--option")
    of_positioning = positioning_options(gnss, gnss_texts)
    with naming("--method"):
        METHODS[method]
    with naming("--option"):
        return parse_options(method, {"gnss": gnss, "gnss_options": of_positioning, **options})


def usable_map(path: Path | None, scale: float | None) -> None:
    """Refuse, before any work, a suffix that no picture has, and a scale without a map."""
    if path is None and scale is not None:
        raise typer.BadParameter("it is the scale of a map, and no --map is asked for.", param_hint="--scale")
    usable_picture(path, "--map")


def usable_picture(path: Path | None, option: str) -> None:
    """Refuse, before any work, a suffix that no picture has."""
    from app.map.picture.slope_map import picture_format

    if path is not None:
        with naming(option):
            picture_format(path)
