"""Valhalla's programs, run on folders: tiles of a map with one or another elevation, and answers without a server."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np

from fusion.types import Floats


class Valhalla:
    """The programs, on one copy of the tiles of a map."""

    def __init__(self, programs: Path, folder: Path) -> None:
        self._programs, self.folder = programs, folder
        told = [sys.executable, str(programs / "valhalla_build_config.py")]
        self._config: dict[str, Any] = json.loads(
            subprocess.run(told, check=True, capture_output=True).stdout
        )
        self._write(folder / "without.json", folder / "without", folder)

    def _write(self, path: Path, tiles: Path, elevation: Path) -> None:
        config = self._config
        config["mjolnir"] |= {
            "tile_dir": str(tiles),
            "tile_extract": "",
            "concurrency": 1,
            "admin": "",
            "timezone": "",
        }
        config["additional_data"]["elevation"] = str(elevation)
        config["logging"] = {"type": "std_err"}
        path.write_text(json.dumps(config))

    def _run(self, *arguments: str) -> None:
        told = [str(self._programs / "bin" / "valhalla_build_tiles"), "-j", "1", *arguments]
        done = subprocess.run(told, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"valhalla_build_tiles failed: {done.stderr[-500:]}")

    def build(self, pbf: Path) -> None:
        """All of the map but its elevation."""
        (self.folder / "without").mkdir()
        self._run("-c", str(self.folder / "without.json"), "-e", "restrictions", str(pbf))

    def with_elevation(self, name: str, elevation: Path, pbf: Path) -> None:
        """The same with this folder of tiles."""
        shutil.copytree(self.folder / "without", self.folder / name)
        self._write(self.folder / f"{name}.json", self.folder / name, elevation)
        self._run("-c", str(self.folder / f"{name}.json"), "-s", "elevation", "-e", "cleanup", str(pbf))

    def ask(self, name: str, action: str, request: Mapping[str, Any]) -> dict[str, Any]:
        """One answer, by the service's program without a server."""
        told = [str(self._programs / "bin" / "valhalla_service"), str(self.folder / f"{name}.json"), action,
                json.dumps(request)]  # fmt: skip
        done = subprocess.run(told, capture_output=True, text=True, check=False)
        lines = done.stdout.strip().splitlines()
        return cast("dict[str, Any]", json.loads(lines[-1])) if lines else {}


def decoded(polyline: str) -> Floats:
    """Longitudes and latitudes (n, 2) of a polyline of six digits."""
    numbers, value, shift = [], 0, 0
    for letter in polyline:
        five = ord(letter) - 63
        value |= (five & 31) << shift
        shift += 5
        if five < 32:
            numbers.append(~(value >> 1) if value & 1 else value >> 1)
            value = shift = 0
    return np.cumsum(np.array(numbers, float).reshape(-1, 2), axis=0)[:, ::-1] / 1e6
