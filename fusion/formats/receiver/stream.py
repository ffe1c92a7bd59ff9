"""A receiver's byte stream: UBX messages and NMEA sentences in any mixture."""

from __future__ import annotations

from fusion.errors import MalformedLogError
from fusion.formats.base import Data, LogFormat, Notes, Place, build_log
from fusion.formats.receiver import nmea_sentences, ubx_navigation, ubx_older, ubx_raw, ubx_subframes
from fusion.formats.receiver.nmea_sentences import WRONG_CHECKSUM
from fusion.formats.receiver.ubx_frames import SYNC, Frames, find_frames, without_frames
from fusion.messages import say
from fusion.signals import RawGnss
from fusion.types import DriveLog, Progress, SensorTable

ENABLE = say("advice.ubx")


def read_stream(
    data: Data, progress: Progress, kind: LogFormat, *, notes: Notes | None = None, place: Place | None = None
) -> DriveLog:
    """Read both kinds of message; where both fill a table, UBX wins.

    ``place`` says in words where a byte offset is. Raises ``EmptyLogError`` or ``MalformedLogError``.
    """
    notes = notes or Notes()
    frames = find_frames(data, progress)
    where = place or _default_place(data, frames)
    _count_broken(frames, notes, where)
    _warn_of_cut(data, frames, notes, where)
    content = nmea_sentences.NmeaContent()
    text = without_frames(data, frames)
    if b"$" in text:
        content = nmea_sentences.read_sentences(
            text, notes, where, lambda share: progress("read sentences", share)
        )
    del text
    if not len(frames) and not content.sentences:
        sentences = notes.skipped[WRONG_CHECKSUM]
        if sentences:
            raise MalformedLogError(say("receiver.checksums_nmea", description=kind.description, n=sentences))
        if len(frames.corrupt):
            raise MalformedLogError(
                say("receiver.checksums_ubx", description=kind.description, n=len(frames.corrupt)),
                where=say("place.byte", n=frames.corrupt[0]),
            )
        raise MalformedLogError(
            say("receiver.beginning_only", description=kind.description, n=len(data)),
            where=say("place.byte", n=len(data)),
        )
    tables, geoid, raw = _merge(data, frames, content, notes, where)
    progress("read messages", 1.0)
    return build_log(kind, notes, tables, geoid=geoid, advice=ENABLE, raw=raw)


def _default_place(data: Data, frames: Frames) -> Place:
    if len(frames):
        return lambda offset: say("place.byte", n=offset)
    text = bytes(data)
    return lambda offset: say("place.line", n=text.count(10, 0, offset) + 1)


def _count_broken(frames: Frames, notes: Notes, where: Place) -> None:
    for reason, offset in (
        ("UBX messages with a wrong checksum", frames.corrupt),
        ("UBX messages cut off at the end of the file", frames.truncated),
    ):
        if len(offset):
            # for the end of a UBX file there is a warning of its own, see _warn_of_cut
            reported = offset is frames.truncated and len(frames)
            notes.skip(reason, len(offset), "" if reported else where(int(offset[0])))


def _warn_of_cut(data: Data, frames: Frames, notes: Notes, where: Place) -> None:
    """Say that the file ends in mid-message: in a frame, or behind the first of its two sync bytes."""
    if not len(frames):
        return
    at = int(frames.truncated[0]) if len(frames.truncated) else len(data) - 1
    if len(frames.truncated) or (bytes(data[-1:]) == SYNC[:1] and int(frames.end[-1]) == at):
        notes.warn(say("receiver.cut", where=where(at)))


def _merge(
    data: Data, frames: Frames, content: nmea_sentences.NmeaContent, notes: Notes, where: Place
) -> tuple[dict[str, SensorTable], str, RawGnss | None]:
    if not len(frames):
        return dict(content.tables), nmea_sentences.GEOID, None
    stream = ubx_navigation.Stream.decode(data, frames, notes)
    raw = ubx_subframes.read_raw(stream, notes, where)
    no_positions = {ubx_raw.RAWX, ubx_subframes.SFRBX, *ubx_older.NO_POSITIONS}
    if not stream.messages.keys() - no_positions and not content.tables:
        notes.first_offender = notes.first_offender or say("ubx.holds_only", what=stream.inventory())
    notes.dated_after_all()  # undated sentences do not matter beside dated messages
    tables = ubx_navigation.ubx_tables(stream, content.marks, content.dated, notes, where)
    geoid = ubx_navigation.GEOID if "fix" in tables else nmea_sentences.GEOID
    if "fix" not in tables and len(content.tables) and not content.dated:
        notes.undated()
    both = [name for name in content.tables if name in tables]
    if both:
        notes.warn(say("receiver.both", both=" and ".join(both)))
    return {**content.tables, **tables}, geoid, raw
