"""The manifest of an archive: every file in it, what it is, and which of them are one drive. Nothing is sent by it."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fusion.formats.archives.files import BROKEN, File, files_in
from fusion.formats.archives.look import Kind, Looked, Looker, kind_of
from fusion.formats.archives.sheets import MOST_BYTES, is_list, sports_of
from fusion.formats.grouping import Rule, Unclear, grouped, why_left, why_repeated
from fusion.messages import message_of, say

Seen = Callable[[File], None]


@dataclass(frozen=True)
class Manifest:
    """Each file of an archive once, in their order; which of them are one drive, by number; and where that is unclear.

    Every file of kind ``drive`` is in a drive, no other is.
    """

    files: tuple[Looked, ...]
    drives: tuple[tuple[int, ...], ...]
    unclear: tuple[Unclear, ...] = ()

    def counts(self) -> Counter[tuple[Kind, str]]:
        """How many files there are of each kind, of those not on roads of each sport."""
        return Counter((one.kind, one.sport if one.kind is Kind.NOT_ON_ROADS else "") for one in self.files)


@dataclass
class Gathering:
    """Files of an archive, looked at one by one; ``manifest`` when all have been."""

    looker: Looker
    rule: Rule = Rule.AUTO
    files: list[Looked] = field(default_factory=list)
    folders: list[str] = field(default_factory=list)
    contents: dict[tuple[str, str], str] = field(default_factory=dict)
    """What was met with, by digest, and by folder where it only belongs to a drive; archives of one upload share it."""
    _sports: dict[str, str] = field(default_factory=dict)

    def add(self, file: File) -> None:
        """Look at one."""
        self.folders.append(file.folder)
        self.files.append(self._looked(file))

    def _looked(self, file: File) -> Looked:
        if file.fault is not None:
            return Looked(file.name, kind_of(file.fault), message_of(file.fault), size=file.size)
        try:
            if file.own_name.lower().endswith(".csv") and self._is_list(file):
                return Looked(file.name, Kind.NOT_A_LOG, say("archive.list"), size=file.size)
            with file.open() as stream:
                return self.looker.look(stream, file.name)
        except OSError as error:
            why = say("log.unreadable", reason=error.strerror or error)
            return Looked(file.name, Kind.UNREADABLE, why, size=file.size)
        except BROKEN as error:
            why = say("archive.broken_file", error=error or type(error).__name__)
            return Looked(file.name, Kind.BROKEN, why, size=file.size)

    def _is_list(self, file: File) -> bool:
        """Whether it says of which sport files are; that is noted."""
        with file.open() as stream:
            data = stream.read(1 << 20)
            if not is_list(data):
                return False
            data += stream.read(MOST_BYTES)
        before = f"{file.folder}/" if file.folder else ""
        self._sports |= {f"{before}{name}": sport for name, sport in sports_of(data).items()}
        return True

    def manifest(self) -> Manifest:
        """What came of them."""
        files = [
            self.looker.of_sport(one, self._sports[one.name]) if one.name in self._sports else one
            for one in self.files
        ]
        self._mark_repeated(files)
        by_folder = defaultdict[str, list[int]](list)
        for number, one in enumerate(files):
            if one.kind is Kind.DRIVE:
                by_folder[self.folders[number]].append(number)
        drives, unclear = list[tuple[int, ...]](), list[Unclear]()
        for numbers in by_folder.values():
            found = self._grouped(files, numbers)
            drives += found[0]
            unclear += found[1]
        return Manifest(tuple(files), tuple(sorted(drives)), tuple(unclear))

    def _mark_repeated(self, files: list[Looked]) -> None:
        """Of files that hold the same the first counts; what only belongs to a drive may lie in several folders."""
        for number, one in enumerate(files):
            if one.kind is not Kind.DRIVE:
                continue
            alone = one.glance.makes_a_drive or one.glance.is_unread
            first = self.contents.setdefault((one.content, "" if alone else self.folders[number]), one.name)
            if first != one.name:
                files[number] = one.as_other(Kind.REPEATED, why_repeated(first))

    def _grouped(
        self, files: list[Looked], numbers: Sequence[int]
    ) -> tuple[list[tuple[int, ...]], list[Unclear]]:
        glances = [files[k].glance for k in numbers]
        if not any(one.makes_a_drive or one.is_unread for one in glances):
            left: Iterable[int] = range(len(numbers))
            drives, unclear = list[tuple[int, ...]](), list[Unclear]()
        else:
            grouping = grouped(glances, self.rule)
            left = grouping.left
            drives = [tuple(numbers[k] for k in drive) for drive in grouping.drives]
            unclear = [Unclear(tuple(numbers[k] for k in one.files), one.why) for one in grouping.unclear]
        for k in left:
            files[numbers[k]] = files[numbers[k]].as_other(Kind.ALONE, why_left(glances[k]))
        return drives, unclear


def manifest_of(
    root: Path,
    looker: Looker,
    rule: Rule = Rule.AUTO,
    seen: Seen = lambda file: None,
    contents: dict[tuple[str, str], str] | None = None,
) -> Manifest:
    """Look at every file of a folder or a zip; ``seen`` is told of each. ``contents``: those of archives before, which
    is added to. Raises as ``files_in``."""
    gathering = Gathering(looker, rule, contents={} if contents is None else contents)
    for file in files_in(root):
        gathering.add(file)
        seen(file)
    return gathering.manifest()
