"""The files of a batch's slopes."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple, cast

from app.batch.folder import BatchError, BatchFolder
from app.batch.hands import DEAD, Hands
from app.batch.source import SolvedSource
from app.core.messages import say
from app.core.text import utc_text, whole_file
from app.exports.format import WAYS, Format, TableFormat, statements
from app.exports.formats import FORMATS, SEGMENT_FORMATS, write_companions

if TYPE_CHECKING:
    from app.exports.source import Source


OF_DATABASE = ("opensidewalks", "overture")
"""Formats that name segments by the numbers that a database gives them; only one makes ways, too."""


def formats_of_segments() -> list[str]:
    """Names of the formats that can be written without a database."""
    return [name for name, one in FORMATS.items() if name not in OF_DATABASE and not _of_ways(one)]


def _of_ways(one: Format) -> bool:
    return isinstance(one, TableFormat) and one.layer is WAYS


def file_name(chosen: Format) -> str:
    """What a file of a format is called: others than tables of segments and tiles by the format as well."""
    usual = chosen.name in SEGMENT_FORMATS or chosen.suffixes[0] == f".{chosen.name}"
    return f"slopes{'' if usual else f'-{chosen.name}'}{chosen.suffixes[0]}"


def write_outputs(
    hands: Hands, folder: BatchFolder, formats: Sequence[str], source: SolvedSource, attribution: str
) -> list[Path]:
    """Write the segments in each of the formats, side by side; equal solutions make equal bytes.

    What there is to say of the files is noted in the ``source``.
    """
    stated = statements(attribution, source.solution.height_datum)
    stated["changed_at"] = utc_text(source.newest) or ""
    folder.scratch.mkdir(parents=True, exist_ok=True)
    place = folder.scratch / "solved"
    place.write_bytes(pickle.dumps(source, pickle.HIGHEST_PROTOCOL))
    made: dict[str, Written] = {}
    for name, written in hands.results(formats, lambda name: (_write, folder, name, place, stated)):
        if written is DEAD:
            raise BatchError(say("batch.writer_died", name=name))
        made[name] = written
    place.unlink()
    kept = set[Path]()
    for name in formats:
        source.notes += made[name].notes
        kept |= {made[name].path, *made[name].beside}
    remove_outputs(folder, kept)
    return [made[name].path for name in formats]


class Written(NamedTuple):
    """A file, those that belong to it, and what there is to say of them."""

    path: Path
    beside: list[Path]
    notes: list[str]


def _write(folder: BatchFolder, name: str, place: Path, stated: dict[str, str]) -> Written:
    """One format, by whoever it is given to."""
    source: SolvedSource = pickle.loads(place.read_bytes())  # noqa: S301 - our own file
    chosen = FORMATS[name]
    path = folder.slopes(file_name(chosen))
    with whole_file(path) as partial:
        # What formats ask of a source, this one has; but of ways.
        chosen.write(cast("Source", source), partial, stated, chosen.parse_options({}, local=True))
    beside = chosen.companions(path, stated)
    write_companions(beside)
    return Written(path, [*beside], source.notes)


def remove_outputs(folder: BatchFolder, kept: set[Path]) -> None:
    """Remove files of slopes that were written before, of other formats or logs."""
    for path in folder.path.glob("slopes*"):
        if path not in kept:
            path.unlink()
