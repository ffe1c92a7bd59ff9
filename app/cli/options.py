"""Arguments and options that several commands share, and the logs that they name."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from app.cli.console import spoken
from app.core.messages import say
from fusion.errors import BadOptionsError, UnknownNameError
from fusion.messages import message_of
from fusion.registry import check_columns

if TYPE_CHECKING:
    from app.core.db import Bounds
    from fusion.methods.base import Options


def in_a_folder(path: Path | None) -> Path | None:
    """Callback of an option that names a file to write: refuses it now if its folder is missing."""
    if path is not None and not path.parent.is_dir():
        raise typer.BadParameter(spoken(say("options.no_folder", path=path, folder=path.parent)))
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


def parse_box(text: str | None) -> Bounds | None:
    """``WEST,SOUTH,EAST,NORTH`` in degrees; raises ``typer.BadParameter``."""
    if text is None:
        return None
    try:
        west, south, east, north = (float(part) for part in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            spoken(say("options.box", text=text)),
            param_hint="'--bbox'",
        ) from None
    if not (-180 <= west < east <= 180 and -90 <= south < north <= 90):
        raise typer.BadParameter(spoken(say("options.box_order", text=text)), param_hint="'--bbox'")
    return west, south, east, north


@contextmanager
def naming(option: str) -> Iterator[None]:
    """Refuse as wrong usage, and name the option at fault, what the library refuses inside."""
    try:
        yield
    except (UnknownNameError, BadOptionsError) as error:
        raise typer.BadParameter(spoken(message_of(error)), param_hint=f"'{option}'") from error


def _pairs(texts: Sequence[str] | None, option: str, form: str) -> Iterator[tuple[str, str]]:
    """The two sides of ``name=value`` each; ``typer.BadParameter`` says which ``form`` is wanted."""
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not name or not equals:
            raise typer.BadParameter(
                spoken(say("options.not_form", text=text, form=form)), param_hint=f"'{option}'"
            )
        yield name, value


def parse_columns(texts: Sequence[str] | None) -> dict[str, str]:
    """``name=header`` each, a column of ours and what it is called; raises ``typer.BadParameter``."""
    pairs = _pairs(texts, "--columns", say("options.form_header"))
    columns = {name.strip(): header.strip() for name, header in pairs}
    with naming("--columns"):
        check_columns(columns)
    return columns


def parse_assignments(texts: Sequence[str] | None, option: str) -> dict[str, Any]:
    """``name=value`` each: numbers, true and false as such, else text; raises ``typer.BadParameter``."""
    options: dict[str, Any] = {}
    form = say("options.form_value")
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
        raise typer.BadParameter(spoken(say("options.scale_of")), param_hint="--scale")
    usable_picture(path, "--map")


def usable_picture(path: Path | None, option: str) -> None:
    """Refuse, before any work, a suffix that no picture has."""
    from app.map.picture.slope_map import picture_format

    if path is not None:
        with naming(option):
            picture_format(path)
