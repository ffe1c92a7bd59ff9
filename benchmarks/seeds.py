#!/usr/bin/env python3
"""The experiments of the source documents on simulated drives of the same shape, their figures beside ours.

    python benchmarks/seeds.py [DATA_DIR] [--only calais lahrech saadaoui surveyed methods] [--seeds N]
                               [--roadtruth PATH] [--json FILE] [--write]

Parts: ``calais`` (Al Assaad 2020: a 549 s drive through motorway interchanges, chapters 2 and 3, and the unscented
filter that it compares with), ``lahrech`` (Lahrech et al. 2005: 325 s in town with two outages), ``saadaoui`` (Saadaoui
2011: Kalman filters on linear, turning and outage drives), ``surveyed`` (systems that it describes without equations:
vehicles that co-operate, GPS beside a base) and ``methods``: every method on the sequences 09 and 10 of
DATA_DIR (the folder ``karlsruhe``; ``roadtruth.py`` makes logs of them as for ``slope_accuracy.py``). Without DATA_DIR
the last part is left out.

Each row shows what the document prints beside the median, least and most of ours over the seeds, and where they differ
a sentence. ``--write`` puts the tables into the pages of docs/published/, and with ``calais`` draws its picture.
"""

from __future__ import annotations

import argparse
import importlib
import re
import sys
from dataclasses import asdict
from pathlib import Path

from accuracy.arguments import parser_of
from accuracy.scoring import show_progress, write_json
from fusion.errors import FusionError
from published.rows import Row, by_experiment, markdown_table, side_by_side, text_table

PARTS = {
    "calais": "published.particle.calais",
    "lahrech": "published.odometer_map.lahrech",
    "saadaoui": "published.gps_ins.saadaoui",
    "surveyed": "published.gps_ins.surveyed",
    "methods": "published.methods",
}
DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGES = {
    "calais": DOCS / "published" / "al-assaad-2020.md",
    "lahrech": DOCS / "published" / "lahrech-2005.md",
    "saadaoui": DOCS / "published" / "saadaoui-2011.md",
    "surveyed": DOCS / "published" / "saadaoui-2011.md",
    "methods": DOCS / "published" / "index.md",
}
PICTURE = DOCS / "images" / "calais.png"
MARKERS = {"methods": "methods_on_roads"}
"""Names of tables that are not the part's."""
SIDE_BY_SIDE = {"calais"}
"""Parts whose experiments are of the same quantities."""


def run_part(part: str, args: argparse.Namespace) -> list[Row]:
    """The rows of one part; its module is loaded only now."""

    def progress(stage: str, share: float) -> None:
        show_progress(f"{stage} {share:4.0%}")

    print(f"{part} ...", file=sys.stderr)
    module = importlib.import_module(PARTS[part])
    if part == "methods":
        rows = module.run(args.seeds, progress, args.data_dir, args.roadtruth)
    else:
        rows = module.run(args.seeds, progress)
    show_progress("")
    return list(rows)


def renewed(document: str, part: str, rows: list[Row]) -> str:
    """The document with the part's tables in the place between its markers.

    Raises ``ValueError`` where the document has no place for the part.
    """
    if part in SIDE_BY_SIDE:
        tables = side_by_side(rows)
    else:
        groups = by_experiment(rows).items()
        tables = "\n\n".join(f"### {name}\n\n{markdown_table(group)}" for name, group in groups)
    pattern = re.compile(rf"(<!-- table: {MARKERS.get(part, part)} -->\n).*?(\n<!-- end -->)", re.DOTALL)
    text, count = pattern.subn(lambda markers: f"{markers[1]}\n{tables}\n{markers[2]}", document)
    if count != 1:
        raise ValueError(f"{PAGES[part].name} has {count} places for the tables of {part}, not one")
    return text


def write(part: str, rows: list[Row]) -> None:
    """Renew the page."""
    page = PAGES[part]
    page.write_text(renewed(page.read_text(encoding="utf-8"), part, rows), encoding="utf-8")
    if part == "calais":
        importlib.import_module("published.particle.calais_picture").draw(PICTURE)


def chosen_parts(args: argparse.Namespace) -> list[str]:
    """What to run: all that was asked for, the real drives only where they are."""
    if args.data_dir is None and "methods" in (args.only or ()):
        sys.exit("methods: name the folder with the sequences, DATA_DIR")
    return [p for p in args.only or PARTS if p != "methods" or args.data_dir is not None]


def main() -> None:
    """Parse the command line, run, print, write."""
    parser = parser_of(__doc__)
    parser.add_argument("data_dir", type=Path, nargs="?", metavar="DATA_DIR")
    parser.add_argument("--only", nargs="+", choices=PARTS)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--roadtruth", type=Path)
    parser.add_argument("--write", action="store_true", help="renew the tables in docs/published/")
    args = parser.parse_args()
    all_rows: list[Row] = []
    for part in chosen_parts(args):
        try:
            rows = run_part(part, args)
        except FusionError as error:
            sys.exit(f"{part}: {error}")
        print(text_table(rows), end="\n\n", flush=True)
        if args.write:
            write(part, rows)
        all_rows += rows
    write_json(args.json, [asdict(row) for row in all_rows])


if __name__ == "__main__":
    main()
