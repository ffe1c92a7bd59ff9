"""The manifest of archives as people and programs get it: a row for each file, and sums of each kind."""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from app.cli.console import spoken
from app.core.text import whole_file
from fusion.formats.archives.look import Looked
from fusion.formats.archives.manifest import Manifest

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
