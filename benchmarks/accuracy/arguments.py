"""What the command lines of benchmarks have in common, and where the data lies that they take by default."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fusion.errors import FusionError

REPOSITORY = Path(__file__).resolve().parents[2]
SHARED = REPOSITORY.parent / "shared/data"
HEIDELBERG = SHARED / "maps/heidelberg-2024-09.test.osm.pbf"
ELEVATIONS = SHARED / "karlsruhe/N49E008.hgt"


def parser_of(description: str | None) -> argparse.ArgumentParser:
    """A command line with ``--json``. Threads wait from now on as the product's own command line lets them."""
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the figures to this file")
    return parser


def data_parser_of(description: str | None, tool: str = "roadtruth") -> argparse.ArgumentParser:
    """The same with what benchmarks on recorded data take: DATA_DIR, and where a tool lies."""
    parser = parser_of(description)
    parser.add_argument("data_dir", type=Path, metavar="DATA_DIR")
    parser.add_argument(f"--{tool}", type=Path, metavar="PATH", help=f"where {tool}.py lies")
    return parser


def add_roads(parser: argparse.ArgumentParser) -> None:
    """``--roads``, a map that has to be there."""
    parser.add_argument(
        "--roads", type=existing, default=str(HEIDELBERG), help="road map (default: Heidelberg)"
    )


def existing(text: str) -> Path:
    """A path at which there is something."""
    path = Path(text)
    if not path.exists():
        raise argparse.ArgumentTypeError(f"{path}: not there")
    return path


@contextmanager
def plain_errors() -> Iterator[None]:
    """What the library refuses within the block ends the program with its sentence."""
    try:
        yield
    except FusionError as error:
        sys.exit(str(error))


def numbers(text: str) -> list[int]:
    """``1,10,40`` as numbers."""
    return [int(part) for part in text.split(",")]
