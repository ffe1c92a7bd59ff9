"""A grid of the geoid where PROJ looks for it."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyproj

APART_M = 47.5


@contextmanager
def installed_grid(folder: Path) -> Iterator[None]:
    """An EGM96 that is 47.5 m above the ellipsoid between 45 and 55 degrees north and 0 and 20 degrees east."""
    rows, columns = 11, 21
    header = struct.pack(">4d2i", 45.0, 0.0, 1.0, 1.0, rows, columns)
    posts = struct.pack(f">{rows * columns}f", *[APART_M] * rows * columns)
    (folder / "egm96_15.gtx").write_bytes(header + posts)
    before = pyproj.datadir.get_data_dir()
    pyproj.datadir.append_data_dir(str(folder))
    try:
        yield
    finally:
        pyproj.datadir.set_data_dir(before)
