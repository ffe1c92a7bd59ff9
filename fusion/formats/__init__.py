"""Log formats: bytes in, a ``DriveLog`` out. One file (or folder) per format, one line in the registry below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from fusion.errors import EmptyLogError, LogError, MalformedLogError, UnknownFormatError
from fusion.formats.base import LogFormat, Notes, refuse_many
from fusion.formats.container import Member, is_zip, load, members, refuse, shown_name
from fusion.formats.fit.log import FitFormat
from fusion.formats.glance import HEAD_BYTES, Ends, Glance
from fusion.formats.gpx import GpxFormat
from fusion.formats.grouping import Grouping, Rule, grouped, why_left, why_repeated
from fusion.formats.nmea import NmeaFormat
from fusion.formats.phones.gnsslogger import GnssLoggerFormat
from fusion.formats.phones.mounting import in_vehicle_axes
from fusion.formats.phones.sensor_logger import SensorLoggerFormat
from fusion.formats.pseudoranges_csv import PseudorangesCsvFormat
from fusion.formats.rinex.log import RinexFormat
from fusion.formats.rtklib_pos import RtklibPosFormat
from fusion.formats.tables.log import NamedColumnsCsv
from fusion.formats.tables.table import TakenColumn, taken_columns
from fusion.formats.tcx import TcxFormat
from fusion.formats.torque import TorqueFormat
from fusion.formats.ubx import UbxFormat
from fusion.formats.ucenter import UCenterFormat
from fusion.formats.upload_bundle import Part, join
from fusion.formats.versant_csv import VersantCsvFormat
from fusion.messages import Message, message_of, say
from fusion.registry import Registry, check_columns
from fusion.signals import Navigation
from fusion.types import DriveLog, Progress, no_progress

MAX_BYTES = 512 << 20
"""Unpacked size up to which a log is read unless the caller says otherwise: days of driving, and what it takes to
read it fits the memory of a small server."""

MOST_NAMED = 5
"""Files that one warning names."""

FORMATS: Registry[LogFormat] = Registry("log format")
# asked in this order: the loosest, CSV, comes last
FORMATS.add("rinex", RinexFormat())
FORMATS.add("fit", FitFormat())
FORMATS.add("gnsslogger", GnssLoggerFormat())
FORMATS.add("ubx", UbxFormat())
FORMATS.add("u-center", UCenterFormat())
FORMATS.add("nmea", NmeaFormat())
FORMATS.add("gpx", GpxFormat())
FORMATS.add("tcx", TcxFormat())
FORMATS.add("pseudoranges-csv", PseudorangesCsvFormat())
FORMATS.add("sensor-logger", SensorLoggerFormat())
FORMATS.add("rtklib-pos", RtklibPosFormat())
FORMATS.add("torque", TorqueFormat())
FORMATS.add("csv", VersantCsvFormat())


Source = bytes | Path | BinaryIO


def read_log(
    source: Source,
    *,
    columns: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
    progress: Progress = no_progress,
) -> DriveLog:
    """Read a drive log of any registered format, recognised by content, gzipped or not, or several in a zip.

    ``columns`` says how a CSV calls our columns, ours -> the header's. ``max_bytes`` bounds the unpacked size. Raises
    ``LogError``: ``UnknownFormatError`` if no format recognises the bytes, ``EmptyLogError`` if there is no usable
    position nor raw data to make one of, ``MalformedLogError`` if it is too large or broken beyond skipping; and
    ``BadOptionsError`` for ``columns`` that are none of ours.
    """
    check_columns(columns or {})
    job = _Job(max_bytes, progress, columns or {}, Notes())
    data = load(source, max_bytes, job.notes, progress)
    if is_zip(data) and (files := members(data, max_bytes, job.notes)):
        del data
        return _usable(_read_bundle(files, job))
    name = source.name if isinstance(source, Path) else ""
    return _usable(_read_single(name, data, job))


def read_logs(
    sources: Sequence[Source],
    *,
    names: Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
    progress: Progress = no_progress,
) -> DriveLog:
    """Read the files of one drive, each as by ``read_log``, and join them into one log; a single file is that log.

    Messages call the files by ``names``; without them, paths by their own names, and other sources by number.
    ``max_bytes`` bounds the unpacked size of all of them. Files that are no logs are left out with a warning, unless
    there is nothing else. Raises as ``read_log``.
    """
    if not sources:
        raise EmptyLogError(say("log.no_file"))
    if len(sources) == 1:
        return read_log(sources[0], columns=columns, max_bytes=max_bytes, progress=progress)
    check_columns(columns or {})
    job = _Job(max_bytes, progress, columns or {}, Notes())
    return _usable(_read_bundle(_files_of(sources, names, job), job))


@dataclass(frozen=True)
class SortedFiles:
    """The ``files`` of some sources, those in zips by themselves, unpacked, and by number which are one drive;
    ``left_out`` says of files that are in none why, by name."""

    files: tuple[Member, ...]
    grouping: Grouping
    left_out: tuple[tuple[str, str], ...]


def sort_files(
    sources: Sequence[Source],
    *,
    columns: Mapping[str, str] | None = None,
    rule: Rule = Rule.AUTO,
    max_bytes: int = MAX_BYTES,
) -> SortedFiles:
    """Tell which files are one drive (``fusion.formats.grouping``), by a glance at each. Raises as ``read_logs``, but
    not for a file that is no log, or a broken one: it is left out."""
    job = _Job(max_bytes, no_progress, columns or {}, Notes())
    files, glances, left_out, seen = (
        list[Member](),
        list[Glance](),
        list[tuple[str, str]](),
        dict[bytes, str](),
    )
    for file in _files_of(sources, (), job):
        data = load(file.data, max_bytes, job.notes, no_progress)
        if data in seen:
            left_out.append((file.name, why_repeated(seen[data])))
            continue
        seen[data] = file.name
        try:
            glances.append(glance_at(Ends.of(data), file.name, columns))
        except LogError as error:
            left_out.append((file.name, in_short(error)))
            continue
        files.append(Member(file.name, data))
    grouping = grouped(glances, rule)
    left_out += [(files[k].name, why_left(glances[k])) for k in grouping.left]
    return SortedFiles(tuple(files), grouping, tuple(left_out))


def in_short(error: LogError) -> str:
    """What is said of one file among several: without the list of what is read."""
    reason = message_of(error)
    return (
        reason.parameters["what"] if isinstance(reason, Message) and reason.key == "log.unknown" else reason
    )


def _files_of(sources: Sequence[Source], names: Sequence[str], job: _Job) -> list[Member]:
    """The files themselves, those in zips too; all of them have at most the job's ``max_bytes``."""
    bytes_left, files = job.max_bytes, list[Member]()
    for count, source in enumerate(sources, 1):
        data = load(source, bytes_left, job.notes, job.progress)
        name = source.name if isinstance(source, Path) else f"file {count}"
        name = shown_name(names[count - 1] if count <= len(names) else name)
        inside = members(data, bytes_left, job.notes) if is_zip(data) else []
        inside = inside or [Member(name, data)]
        bytes_left -= sum(len(member.data) for member in inside)
        files += inside
    return files


@dataclass(frozen=True)
class _Job:
    """The limits and options of one reading, and its notes."""

    max_bytes: int
    progress: Progress
    columns: Mapping[str, str]
    notes: Notes


def _read_single(name: str, data: bytes, job: _Job) -> DriveLog:
    """Read a file that holds a whole drive."""
    chosen = _format_of(data[:HEAD_BYTES], name, job.columns)
    if job.columns and not chosen.has_named_columns:
        job.notes.warn(say("columns.unused", description=chosen.description))
    return _with_notes(_read_as(chosen, data, job.progress, None), job.notes)


def _format_of(head: bytes, name: str, columns: Mapping[str, str]) -> LogFormat:
    """Recognise the format of a file; it learns the file's name and the names that a person gave for columns."""
    chosen = next((f for _, f in FORMATS.items() if f.recognises(head)), None)
    if chosen is None:
        kinds = [say("log.kind", kind=f.description, suffixes=list(f.suffixes)) for f in FORMATS.values()]
        raise refuse(head, say("log.supported", kinds=kinds))
    return chosen.with_columns(columns).with_name(name)


def refuse_head(head: bytes, *, part: bool = False, columns: Mapping[str, str] | None = None) -> None:
    """Raise the ``LogError`` that reading will raise, as far as the first bytes of a file (unpacked) tell.

    ``UnknownFormatError`` if they are of no log, ``MalformedLogError`` if a header lacks what it must have; ``part``:
    the file may be one of several of a drive. Says nothing of a log that is broken or empty farther on.
    """
    _format_of(head, "", columns or {}).refuse_header(head, part=part)


def columns_of(head: bytes, columns: Mapping[str, str] | None = None) -> tuple[TakenColumn, ...]:
    """What the columns of a CSV are taken as, by its first bytes (unpacked); none where it is no table that people can
    name columns of. ``columns``: what they are said to be; what the header has not is passed over."""
    chosen = next((f for _, f in FORMATS.items() if f.recognises(head)), None)
    if not isinstance(chosen, NamedColumnsCsv):
        return ()
    return taken_columns(head, chosen.with_columns(columns or {}).schema(part=True))


def glance_at(ends: Ends, name: str = "", columns: Mapping[str, str] | None = None) -> Glance:
    """What a file, unpacked, holds and from when to when, in milliseconds however long it is.

    Raises ``UnknownFormatError`` where no format recognises it, and what reading will raise where it is short. Of a
    long file whose ends tell nothing, nothing is known.
    """
    chosen = _format_of(ends.head, name, columns or {})
    try:
        return chosen.glance(ends)
    except LogError:
        if ends.is_short:
            raise
        return Glance(chosen.name, is_unread=True)


def _read_as(chosen: LogFormat, data: bytes, progress: Progress, navigation: Navigation | None) -> DriveLog:
    """Read bytes by a format; as a part of a drive if the ``navigation`` of the other parts is given."""
    try:
        progress(f"read {chosen.name}", 0.0)
        if navigation is not None:
            return chosen.read_part(data, progress, navigation)
        return chosen.read(data, progress)
    except MemoryError as error:
        raise MalformedLogError(say("log.needs_memory")) from error


def _usable(log: DriveLog) -> DriveLog:
    """The log with its inertial sensors in the vehicle's axes; ``MalformedLogError`` where it is too long."""
    refuse_many(len(log.fix), 0 if log.raw is None else len(log.raw.signals))
    return in_vehicle_axes(log)


def _with_notes(log: DriveLog, notes: Notes) -> DriveLog:
    return replace(
        log,
        skipped=notes.skipped + log.skipped,
        repaired=notes.repaired + log.repaired,
        warnings=(*notes.warnings, *log.warnings),
    )


def _read_bundle(members: list[Member], job: _Job) -> DriveLog:
    """Read the files of an upload bundle as one log; a single file is read as if it came without the zip."""
    notes, progress = job.notes, job.progress
    if len(members) == 1 and not is_zip(members[0].data):
        return _read_single(members[0].name, load(members[0].data, job.max_bytes, notes, progress), job)
    errors: list[LogError] = []
    files = _recognise_files(members, job, errors)
    parts: list[Part] = []
    navigation = Navigation()
    # other files are read better once those that come first have been
    for file in sorted(files, key=lambda one: not one.format.comes_first(one.data[:HEAD_BYTES])):
        try:
            log = _with_notes(_read_as(file.format, file.data, progress, navigation), file.notes)
        except (EmptyLogError, MalformedLogError) as error:
            errors.append(error)
            notes.skip("files that cannot be used", 1)
            notes.warn(say("log.left_out", name=file.name, error=error))
            continue
        if log.raw is not None:
            navigation = navigation.joined(log.raw.navigation)
        parts.append(Part(file.name, log))
    if not parts:
        raise errors[-1]
    _warn_of_several(parts, notes)
    try:
        return join(parts, notes)
    except EmptyLogError as nothing:
        broken = [error for error in errors if not isinstance(error, UnknownFormatError)]
        raise (broken[0] if broken else nothing) from None


def _warn_of_several(parts: list[Part], notes: Notes) -> None:
    """Say where the parts of one drive look like several."""
    drives = grouped([Glance.of(part.log) for part in parts]).drives
    if len(drives) > 1:
        begin = ", ".join(parts[drive[0]].name for drive in drives[:MOST_NAMED])
        more = say("more", n=len(drives) - MOST_NAMED) if len(drives) > MOST_NAMED else ""
        notes.warn(say("log.many_drives", n=len(drives), begin=begin, more=more))


@dataclass(frozen=True)
class _File(Member):
    """A file whose format is known, not read yet; ``notes`` are of its unpacking."""

    format: LogFormat
    notes: Notes


def _recognise_files(members: list[Member], job: _Job, errors: list[LogError]) -> list[_File]:
    """Unpack the files that are logs; count the others and add their errors to ``errors``."""
    bytes_left, out = job.max_bytes, list[_File]()
    for member in members:
        own = Notes()
        data = load(member.data, bytes_left, own, job.progress)
        bytes_left -= len(data)
        try:
            out.append(_File(member.name, data, _format_of(data[:HEAD_BYTES], member.name, job.columns), own))
        except UnknownFormatError as error:
            errors.append(error)
            job.notes.skip("files that are no logs", 1, member.name)
    return out
