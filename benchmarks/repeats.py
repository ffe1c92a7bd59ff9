#!/usr/bin/env python3
"""The same road driven twice by real devices: do two results differ by what their sigmas let expect?

    python benchmarks/repeats.py DATA_DIR [--method NAME] [--only TEXT] [--repeats PATH] [--json FILE]

DATA_DIR is the folder ``repeats``, or the one that holds it: two days of a phone in a car (134 km, 1 Hz), and three
drives of a car's black box. The tool ``repeats.py`` (by default ``../tools`` beside the parent of the folder) makes
roads along the first log of a pair, segments of 100 m, or 60 m for the black box. Each drive is fused by itself with
these roads, as ``versant fuse`` does, without an elevation model. Rows by what is left of the logs:

    phone: altitude and pressure     as recorded
    phone: altitude                  without ``pressure_hpa``
    phone: pressure                  without ``height_ell_m`` and ``v_acc_m``
    black box                        altitudes without accuracies

Printed by the tool: segments that both drives covered by more than 80 %, root mean square of their difference in
percent of slope, what the sigmas let expect, and the share of differences within 1.96 of both sigmas together; then the
rms over the expected. Errors that both drives share stay hidden: a good row proves less than a bad one. No constant of
the library may be fitted to these logs: they are a check.
"""

from __future__ import annotations

import json
import sys
import tempfile
from argparse import Namespace
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from accuracy.arguments import data_parser_of, plain_errors
from accuracy.logs import drop_columns
from accuracy.scoring import Row, show_progress, text_table, write_json
from accuracy.sequences import folder_of, load_tool, quietly, tool_beside
from app.cli.logs.fusing import Fusion
from fusion.pipeline import parse_options
from fusion.registry import DEFAULT_METHOD
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable

COLUMNS = {
    "pair": ("two drives", ""),
    "segments": ("segments", "d"),
    "rms": ("rms of A - B %", ".3f"),
    "expected": ("expected %", ".3f"),
    "ratio": ("ratio", ".2f"),
    "within_95": ("in 1.96s", ".1%"),
}
PHONE, BLACK_BOX = ("2025-07-04_17-24-46", "2025-07-11_13-33-16"), "nds-15"
PHONE_SPACING_M, BLACK_BOX_SPACING_M = 100.0, 60.0
ALTITUDE, PRESSURE = ("height_ell_m", "v_acc_m"), ("pressure_hpa",)


class Pair(NamedTuple):
    """Two drives over the same road, and the columns that are taken away from both logs."""

    first: str
    second: str
    spacing_m: float
    without: tuple[str, ...] = ()


PAIRS = {
    "phone: altitude and pressure": Pair(*PHONE, PHONE_SPACING_M),
    "phone: altitude": Pair(*PHONE, PHONE_SPACING_M, PRESSURE),
    "phone: pressure": Pair(*PHONE, PHONE_SPACING_M, ALTITUDE),
    "black box (nds-15, nds-8)": Pair(BLACK_BOX, "nds-8", BLACK_BOX_SPACING_M),
    "black box (nds-15, nds-5)": Pair(BLACK_BOX, "nds-5", BLACK_BOX_SPACING_M),
}


@dataclass
class Setup:
    """The recorded logs, and what they are compared with."""

    data: Path
    tool: ModuleType
    folder: Path
    method: str

    def score(self, pair: Pair) -> Row:
        """What two drives, each by itself, say of each other."""
        roads = self.roads(pair)
        results = [self.result(name, roads, pair.without) for name in (pair.first, pair.second)]
        return self.compared(*results)

    def roads(self, pair: Pair) -> RoadTable:
        """The roads along the first drive."""
        out = self.folder / f"{pair.first}.osm"
        log = self.data / f"{pair.first}.csv"
        quietly(self.tool.roads, log=str(log), out=str(out), spacing=pair.spacing_m)
        return read_roads(out)

    def result(self, name: str, roads: RoadTable, without: tuple[str, ...]) -> Path:
        """The slopes of one drive by itself."""
        log = drop_columns(self.data / f"{name}.csv", without, self.folder / f"{name}.csv")
        fusion = Fusion(self.method, parse_options(self.method), roads, None)
        fusion.add(log)
        return self.written(fusion, name)

    def written(self, fusion: Fusion, name: str) -> Path:
        """A result as the file that the tool reads."""
        out = self.folder / f"{name}.geojson"
        features = [feature.geojson() for feature in fusion.features()]
        out.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        return out

    def compared(self, first: Path, second: Path) -> Row:
        """The tool's figures of two results."""
        row: Row = json.loads(quietly(self.tool.score, first=str(first), second=str(second), json=None))
        return row | {"ratio": row["rms"] / row["expected"]}


EXTRA: dict[str, Callable[[Setup], Row]] = {}
"""Rows that are no plain pair. THE PLACE TO ADD one: pressure alone on the second day, with the first day's log, fused
with everything, beside it; made of ``Setup.roads``, ``written`` and ``compared``."""


def run(args: Namespace, folder: Path) -> list[Row]:
    """Every row whose name holds the text that was asked for."""
    data = folder_of(args.data_dir, "repeats")
    setup = Setup(data, load_tool(args.repeats or tool_beside(data, "repeats.py")), folder, args.method)
    names = [name for name in (*PAIRS, *EXTRA) if args.only in name]
    if not names:
        sys.exit(f"no row holds {args.only!r}; there are: {', '.join([*PAIRS, *EXTRA])}")
    rows = []
    for name in names:
        show_progress(name)
        figures = setup.score(PAIRS[name]) if name in PAIRS else EXTRA[name](setup)
        rows.append({"pair": name, **figures})
    show_progress("")
    return rows


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__, tool="repeats")
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--only", default="", metavar="TEXT", help="rows whose name holds the text")
    args = parser.parse_args()
    with plain_errors(), tempfile.TemporaryDirectory() as folder:
        rows = run(args, Path(folder))
    print(text_table(rows, COLUMNS))
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
