"""How many records a second each reader of the registry reads, and the memory that it takes.

    PYTHONPATH=.:benchmarks python -m reading [NAME ...] [--records 400000] [--repeats 2] [--json FILE]

Made-up logs of so many records of every format (``logs``). Seconds are of processor time, the least of the repeats,
each in a process of its own; memory is what it had at most, beyond what it had before with the log's bytes. Beside it
stands what a library takes for the same bytes, where there is one: pyarrow for CSV, the XML parser for GPX and TCX,
others' readers for UBX, NMEA and FIT. A reader that is slower than ``GOAL`` and slower than the
library is marked; ``--check`` makes that the exit status.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import Any

from accuracy.scoring import show_progress, text_table, write_json
from fusion.formats import FORMATS
from reading.logs import LIBRARIES, MAKERS
from reading.measuring import apart, parse, read, write

GOAL = 200_000
"""Records a second."""
COLUMNS = {
    "name": ("format", ""), "megabytes": ("MB", ".1f"), "records": ("records", "d"), "seconds": ("s", ".2f"),
    "rate": ("records/s", ".0f"), "memory_mb": ("memory, MB", ".0f"), "library": ("library", ""),
    "library_rate": ("its records/s", ".0f"), "said": ("", ""),
}  # fmt: skip


def main() -> None:
    """Measure the readers named, or all."""
    options = _options()
    rows: list[dict[str, Any]] = []
    for number, name in enumerate(options.names):
        show_progress(f"{name}, {number + 1} of {len(options.names)}")
        rows.append(_measured(name, options.records, options.repeats))
    print(text_table(rows, COLUMNS))
    if options.json:
        write_json(options.json, {"records": options.records, "readers": rows})
    if options.check and any(row["said"] for row in rows):
        sys.exit(1)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "names", nargs="*", metavar="NAME", choices=[*MAKERS, []], help="formats; all if none"
    )
    parser.add_argument("--records", type=int, default=400_000)
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--json", metavar="FILE")
    parser.add_argument("--check", action="store_true", help="exit status 1 where a reader is too slow")
    options = parser.parse_args()
    options.names = options.names or list(FORMATS)
    return options


def _measured(name: str, records: int, repeats: int) -> dict[str, Any]:
    """One reader's row."""
    with tempfile.TemporaryDirectory(prefix="versant-reading-") as folder:
        path = Path(folder) / name
        apart(write, name, records, path)
        own = [apart(read, name, path) for _ in range(repeats)]
        seconds = min(one["seconds"] for one in own)
        row: dict[str, Any] = {
            "name": name, "megabytes": own[0]["megabytes"], "records": records, "seconds": seconds,
            "rate": records / seconds, "memory_mb": min(one["memory_mb"] for one in own),
            "library": "", "library_rate": float("nan"), "said": "",
        }  # fmt: skip
        if name in LIBRARIES:
            row["library"] = LIBRARIES[name][0]
            row["library_rate"] = records / min(apart(parse, name, path)["seconds"] for _ in range(repeats))
    if row["rate"] < GOAL and not row["rate"] > row["library_rate"]:
        row["said"] = "too slow"
    return row


if __name__ == "__main__":
    main()
