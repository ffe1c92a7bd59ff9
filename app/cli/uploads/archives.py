"""``versant upload`` of archives: first the manifest, then what is a drive, and of every file what came of it."""

from __future__ import annotations

import csv
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.cli.client import Client, RemoteDrive
from app.cli.console import Bars, Console, spoken
from app.cli.logs.named import unclear_words
from app.cli.uploads.choice import ArchiveChoice
from app.cli.uploads.journal import Journal, journal_name
from app.cli.uploads.rows import Upload
from app.cli.uploads.sending import ArchiveSender, Outcome, keys_of
from app.core.messages import say
from app.core.settings.places import default_state_dir
from app.core.text import whole_file
from fusion.formats.archives.files import File, bytes_in
from fusion.formats.archives.look import Kind, Looked
from fusion.formats.archives.manifest import Manifest, manifest_of
from fusion.formats.grouping import Rule

COLUMNS = ("file", "kind", "reason", "sport", "start", "duration_s", "km", "bytes", "sha256", "drive")
"""``sha256`` is of what a file unpacks to; ``drive`` numbers the drives of an archive: files of one are one drive."""


@dataclass(frozen=True)
class Archive:
    """One that is named, and what is in it."""

    root: Path
    manifest: Manifest

    def names(self, number: int) -> str:
        """The files of a drive."""
        return ", ".join(self.manifest.files[k].name for k in self.manifest.drives[number])


def summary_of(archives: Sequence[Archive]) -> list[list[Any]]:
    """Kind, sport, number of files, hours, kilometres and megabytes, for each kind and sport that there are."""
    groups: dict[tuple[str, str], list[Looked]] = {}
    for archive in archives:
        for file in archive.manifest.files:
            groups.setdefault((file.kind.value, file.sport), []).append(file)
    return [[kind, sport or None, *_sums(files)] for (kind, sport), files in sorted(groups.items())]


def _sums(files: Sequence[Looked]) -> list[float | int | None]:
    def total(values: list[float]) -> float | None:
        known = [value for value in values if math.isfinite(value)]
        return sum(known) if known else None

    hours = total([file.duration_s / 3600.0 for file in files])
    km = total([file.distance_m / 1000.0 for file in files])
    return [len(files), hours, km, sum(file.size for file in files) / 1e6]


def write_manifest(path: Path, archives: Sequence[Archive]) -> None:
    """Every file as a row of a CSV."""
    with whole_file(path) as partial, partial.open("w", encoding="utf-8", newline="") as out:
        table = csv.DictWriter(out, COLUMNS)
        table.writeheader()
        for archive in archives:
            table.writerows(rows_of(archive))


def rows_of(archive: Archive) -> list[dict[str, Any]]:
    """Every file of an archive as a row of ``COLUMNS``."""
    drive_of = {k: number for number, drive in enumerate(archive.manifest.drives, 1) for k in drive}
    return [
        {
            "file": str(archive.root / one.name) if archive.root.is_dir() else f"{archive.root}: {one.name}",
            "kind": one.kind.value,
            "reason": spoken(one.reason),
            "sport": one.sport or None,
            "start": _time(one.first_s),
            "duration_s": _rounded(one.duration_s),
            "km": _rounded(one.distance_m / 1000.0),
            "bytes": one.size,
            "sha256": one.content or None,
            "drive": drive_of.get(k),
        }
        for k, one in enumerate(archive.manifest.files)
    ]


def _time(unix_s: float) -> str | None:
    if not math.isfinite(unix_s):
        return None
    return datetime.fromtimestamp(unix_s, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _rounded(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None


OUTCOMES = ("outcome", "kind", "files")
SUMMARY = ("kind", "sport", "files", "hours", "km", "megabytes")


@dataclass
class Archives:
    """Those that one command names, looked at; after ``send`` also what came of each drive, by archive and number."""

    archives: list[Archive]
    choice: ArchiveChoice
    console: Console
    outcome_of: dict[tuple[int, int], Outcome] = field(default_factory=dict)
    uploads: dict[tuple[int, int], Upload] = field(default_factory=dict)

    @classmethod
    def looked_at(
        cls,
        roots: Sequence[Path],
        choice: ArchiveChoice,
        columns: Mapping[str, str],
        console: Console,
        bars: Bars,
        *,
        apart: bool,
    ) -> Archives:
        """Look at every file, and say what is in them. What an archive named before holds as well is repeated."""
        looker, rule = choice.looker(columns), Rule.APART if apart else Rule.AUTO
        contents: dict[tuple[str, str], str] = {}
        found = []
        for root in roots:
            more = bars.count(say("stage.looking", name=root.name), bytes_in(root))
            manifest = manifest_of(root, looker, rule, _counting(more), contents)
            found.append(Archive(root, manifest))
        archives = cls(found, choice, console)
        archives._tell()
        return archives

    def _tell(self) -> None:
        for one in self.archives:
            manifest, n = one.manifest, len(one.manifest.files)
            self.console.note(say("archive.holds", name=one.root, n=n, drives=len(manifest.drives)))
            for doubt in manifest.unclear:
                names = [manifest.files[k].name for k in doubt.files]
                self.console.warn(str(one.root), [unclear_words(names, doubt.why.value)])
        self.console.table(SUMMARY, summary_of(self.archives))
        if self.choice.manifest is not None:
            write_manifest(self.choice.manifest, self.archives)

    def send(self, client: Client, computation: dict[str, Any], bars: Bars) -> list[Upload]:
        """Send the drives; a line for each, and for each file that is in none."""
        roots = [one.root for one in self.archives]
        name = journal_name(client.server, client.key_mark, roots)
        path = self.choice.journal or default_state_dir() / "uploads" / name
        with Journal(path, client.server) as journal:
            if len(journal):
                self.console.note(say("journal.goes_on", path=path, n=len(journal)))
            else:
                self.console.note(say("journal.is_at", path=path))
            sender = ArchiveSender(client, journal, computation)
            for at, one in enumerate(self.archives):
                more = bars.count(say("stage.sending", name=one.root.name), len(one.manifest.drives))
                sender.send(one.root, one.manifest, self._taking(at, more), keys_of(one.manifest))
        return [upload for at in range(len(self.archives)) for upload in self._lines(at)]

    def _taking(self, at: int, more: Callable[[int], None]) -> Callable[[int, Outcome], None]:
        def done(number: int, outcome: Outcome) -> None:
            self.outcome_of[at, number] = outcome
            more(1)

        return done

    def _lines(self, at: int) -> list[Upload]:
        archive, lines = self.archives[at], list[Upload]()
        for number in range(len(archive.manifest.drives)):
            outcome, name = self.outcome_of[at, number], f"{archive.root}: {archive.names(number)}"
            remote = None
            if outcome.drive is not None:
                remote = RemoteDrive(outcome.drive, outcome.status, None, 0.0, outcome.reason, {})
            else:
                self.console.complain(f"{name}: {spoken(outcome.reason or '')}")
            self.uploads[at, number] = Upload(name, remote, outcome.reason)
            lines.append(self.uploads[at, number])
        return lines + [
            Upload(
                f"{archive.root}: {one.name}", None, one.reason, left_out=one.kind.value, is_of_archive=True
            )
            for one in archive.manifest.files
            if one.kind is not Kind.DRIVE
        ]

    def outcomes(self) -> list[dict[str, Any]]:
        """Each file, what it is, and the one outcome that it had: ``left out``, or that of its first drive."""
        out = []
        for at, archive in enumerate(self.archives):
            rows = rows_of(archive)
            for number, drive in reversed([*enumerate(archive.manifest.drives)]):
                upload = self.uploads.get((at, number))
                for k in drive:
                    rows[k]["drive"] = upload.drive.id if upload and upload.drive else None
                    rows[k]["outcome"] = upload.status if upload else "not sent"
                    rows[k]["reason"] = rows[k]["reason"] or spoken((upload.reason if upload else "") or "")
            out += [{"outcome": "left out", **row} for row in rows]
        return out

    def tell_outcomes(self) -> None:
        """Say how many files came to what."""
        counts = Counter((str(one["outcome"]), str(one["kind"])) for one in self.outcomes())
        self.console.table(OUTCOMES, [[*key, n] for key, n in sorted(counts.items())])


def _counting(more: Callable[[int], None]) -> Callable[[File], None]:
    return lambda file: more(file.size)
