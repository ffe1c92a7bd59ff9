"""Roads whose true slopes are known, receivers' logs of drives over them, and what the library makes of those.

A folder of data holds sequences: ``ref_XX.csv`` (precise track) with ``truth_XX.csv`` (slope per segment) and a road
file whose name contains XX; or one real log, ``log.csv`` with ``roads.osm``, ``truth.csv`` and its precise track
``ref.csv``. The tool ``roadtruth.py`` makes logs from precise tracks, and the truth where it is missing.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from accuracy.truth import Key, Truth, passes_of, read_truth, with_sigmas
from app.cli.logs.fusing import Fusion
from app.map.segment import Segment
from fusion.errors import MissingSensorError, NoMatchError
from fusion.pipeline import parse_options
from fusion.roads.osm import read_roads
from fusion.roads.table import RoadTable
from fusion.terrain.dem import Dem

RECEIVERS = ("m8", "phone", "f9p")
NOISE_FREE = "noise-free"
"""The receiver that errs by millimetres and says so. What is wrong with slopes from its logs is wrong with the sampling
once a second, with the line of the road on the map, with the definition of the truth, or with the estimator. The body's
movement on its springs stays in its pitch and accelerations, and one percent in its speed signal: the tool has no
log without them."""
_TINY = {"mount": 0.0, "acc_bias": 0.0, "bias_v": 0.0, "pitch": 0.01, "acc": 0.001, "vh": 0.002, "vv": 0.002}
_NOISE_FREE = {"h": (0.002, 100, 0.001), "v": (0.002, 120, 0.001), "h_acc": 0.01, "v_acc": 0.01, **_TINY}
Slopes = dict[Key, tuple[float, float]]
"""Slope and sigma in percent."""


@dataclass(frozen=True)
class Sequence:
    """A stretch of road with its truth; ``log`` is None where logs are made from ``reference``, its precise track."""

    name: str
    truth: Truth
    roads: RoadTable
    dem: Dem | None
    reference: Path | None
    log: Path | None


def find_sequences(folder: Path, tool: ModuleType | None = None, names: str | None = None) -> list[Sequence]:
    """Every sequence in ``folder``, or those of ``names``, separated by commas.

    ``tool`` is ``roadtruth``, asked for a truth that is not there.
    """
    tiles = sorted([*folder.glob("*.hgt"), *folder.glob("*.tif")])
    dem = Dem.open(tiles) if tiles else None
    sequences = [_surveyed(folder, reference, dem) for reference in sorted(folder.glob("ref_*.csv"))]
    if (folder / "log.csv").exists():
        sequences.append(_recorded(folder, dem, tool))
    if not sequences:
        sys.exit(f"{folder}: neither ref_*.csv nor log.csv")
    wanted = [s for s in sequences if names is None or s.name in names.split(",")]
    if not wanted:
        sys.exit(f"{folder}: no sequence named {names}")
    return wanted


def _surveyed(folder: Path, reference: Path, dem: Dem | None) -> Sequence:
    """The road of a precise track, of which logs are made."""
    name = reference.stem.removeprefix("ref_")
    roads = read_roads(road_file(folder, name))
    truth = read_truth(reference.with_name(reference.name.replace("ref_", "truth_")))
    truth = with_sigmas(truth, passes_of(reference, roads), made_log=True)
    return Sequence(name=name, truth=truth, roads=roads, dem=dem, reference=reference, log=None)


def _recorded(folder: Path, dem: Dem | None, tool: ModuleType | None) -> Sequence:
    """The real log of a folder."""
    reference, file = folder / "ref.csv", folder / "truth.csv"
    roads = read_roads(folder / "roads.osm")
    truth = read_truth(file) if file.exists() else made_truth(tool, reference, folder / "roads.osm")
    if reference.exists():
        truth = with_sigmas(truth, passes_of(reference, roads), made_log=False)
    return Sequence(
        name=folder.name,
        truth=truth,
        roads=roads,
        dem=dem,
        reference=reference if reference.exists() else None,
        log=folder / "log.csv",
    )


def road_file(folder: Path, name: str) -> Path:
    """The road file for sequence ``name``: its name holds the sequence's."""
    fitting = [p for p in sorted(folder.glob("roads*.osm*")) if name in p.name.split(".")[0].split("_")]
    if not fitting:
        sys.exit(f"{folder}: no road file whose name holds {name!r}")
    return fitting[0]


def made_truth(tool: ModuleType | None, reference: Path, roads: Path) -> Truth:
    """The true slopes by a precise track."""
    if tool is None:
        sys.exit(f"{reference.parent}: no truth.csv, and roadtruth.py, which makes one, is not there")
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "truth.csv"
        quietly(tool.truth, ref=str(reference), roads=str(roads), out=str(out))
        return read_truth(out)


def folder_of(data_dir: Path, name: str) -> Path:
    """The folder ``name`` of the data: ``data_dir`` itself, or the one of that name in it."""
    folder = data_dir if data_dir.resolve().name == name else data_dir / name
    if not folder.is_dir():
        sys.exit(f"{data_dir}: holds no folder {name!r}, and is not that folder")
    return folder


def load_tool(path: Path) -> ModuleType:
    """One of the tools that lie beside the data, such as ``roadtruth.py``, as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    if spec is None or spec.loader is None or not path.exists():
        sys.exit(f"{path}: not there; name {path.name} by --{path.stem}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def tool_beside(folder: Path, name: str = "roadtruth.py") -> Path:
    """Where a tool lies by default: ``../tools`` beside the parent of a folder of data."""
    return folder.resolve().parent.parent / "tools" / name


def quietly(command: Any, **arguments: object) -> str:
    """Run a tool's command with these arguments; returns what it would have printed."""
    messages = io.StringIO()
    with contextlib.redirect_stdout(messages):
        command(SimpleNamespace(**arguments))
    return messages.getvalue()


def make_log(
    tool: ModuleType | None,
    sequence: Sequence,
    seed: int,
    folder: Path,
    profile: str = "m8",
    cut: list[str] | None = None,
) -> Path:
    """The log that a receiver would have made of the sequence's reference track; a real log stays what it is.

    ``profile`` is one of ``RECEIVERS`` or ``NOISE_FREE``, which makes a log even where there is a real one. A seed has
    its own pace and phase of sampling, the same for every profile.
    """
    if sequence.log is not None and profile != NOISE_FREE:
        return sequence.log
    if tool is None or sequence.reference is None:
        raise ValueError("a log is made by the tool from a reference track, and one of them is missing")
    tool.PROFILES.setdefault(NOISE_FREE, _NOISE_FREE)
    out = folder / f"{sequence.name}_{profile}_{seed}.csv"
    quietly(
        tool.drive, ref=str(sequence.reference), out=str(out), seed=seed, rate=1.0, profile=profile, cut=cut
    )
    return out


def fuse(
    sequence: Sequence, logs: Iterable[Path], method: str, options: Mapping[str, str] | None = None
) -> Fusion:
    """Logs put together as ``versant fuse`` does; a log of which the method can make nothing is left out."""
    fusion = Fusion(method, parse_options(method, options), sequence.roads, sequence.dem)
    for log in logs:
        with contextlib.suppress(MissingSensorError, NoMatchError):
            fusion.add(log)
    return fusion


def among(fusion: Fusion, logs: Iterable[Path]) -> Fusion:
    """The same of some of its logs, each fused as it was."""
    chosen = set(logs)
    return replace(fusion, fused=[one for one in fusion.fused if one.source.paths[0] in chosen])


def slopes_of(fusion: Fusion) -> Slopes:
    """Slope and sigma of every segment that has them."""
    return slopes_among(fusion.features() if fusion.fused else ())


def slopes_among(features: Iterable[Segment]) -> Slopes:
    """The same of a result."""
    return {
        (f.osm_way_id, f.from_node, f.to_node): (f.slope_percent, f.slope_sigma_percent)
        for f in features
        if f.slope_percent is not None and f.slope_sigma_percent is not None
    }


def estimate(
    sequence: Sequence, logs: Iterable[Path], method: str, options: Mapping[str, str] | None = None
) -> Slopes:
    """Slope and sigma by segment from logs together."""
    return slopes_of(fuse(sequence, logs, method, options))
