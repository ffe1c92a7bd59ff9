"""Compiling ahead of time: every method and solver runs once on a simulated drive, so that no lane has to compile.

    python -m app.cli.compiling [--first] [--processes N]

That takes two and a half minutes and more than a gigabyte while LLVM optimises; on disk (``fusion.compiled``) it serves
all processes. Done when an image is built, by ``make setup``, and by a worker where it finds that nobody has.
``--first``: the default method alone, by which most drives are computed. ``--processes``: as many share the work. Where
all is there nothing is done.
"""

from __future__ import annotations

import argparse
import hashlib
import multiprocessing
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse
from llvmlite.binding import get_host_cpu_features, get_host_cpu_name
from pydantic import BaseModel

import fusion
from app.cli.console import spoken
from app.core.messages import say
from fusion.catalogue import METHODS, POSITIONINGS
from fusion.compiled import cache_folder
from fusion.errors import FusionError
from fusion.filters.smoother import LANES, LinearModel
from fusion.filters.sparse_inverse import NormalEquations
from fusion.formats import read_log, read_logs
from fusion.pipeline import parse_options, positions_of, run_drive
from fusion.profile.model import STATES
from fusion.published.canyon.drive import canyon_of
from fusion.registry import DEFAULT_METHOD
from fusion.results import solve
from fusion.roads.grid import project_point
from fusion.roads.table import RoadTable
from fusion.simulate.drive import SimulatedDrive, simulate_drive
from fusion.simulate.scene.town import make_town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.rinex_file import navigation, observations
from fusion.simulate.write.ubx_file import write_ubx
from fusion.terrain.dem import Dem
from fusion.types import DriveLog

DURATION_S = 60.0
FEW: Mapping[str, Any] = {"particles": 200}
"""What an option is set to wherever a model has it, so that a run is short."""

_ELSEWHERE = frozenset({"gnss", "gnss_options", "columns"})
"""Options that every method has: positionings are gone through by themselves."""

_LASTING = ExitStack()

Step = tuple[str, Callable[[], object]]


class Scene(NamedTuple):
    """One short drive: its logs, those of its raw signals, and the roads and the elevation around it."""

    logs: list[DriveLog]
    raw: list[DriveLog]
    roads: RoadTable
    dem: Dem


def main() -> None:
    """Compile, and say how far it is."""
    parser = argparse.ArgumentParser(
        prog="python -m app.cli.compiling", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--first", action="store_true", help="the default method alone")
    parser.add_argument("--processes", type=int, default=1, help="as many share the work")
    options = parser.parse_args()
    compile_ahead(first=options.first, processes=options.processes, tell=_tell)


def compile_ahead(
    *, first: bool = False, processes: int = 1, tell: Callable[[str, int, int], None] = lambda *_: None
) -> None:
    """Run what is not known to have been run with this code on this processor; ``tell(name, number, of)`` each."""
    if is_compiled(first=first):
        return
    with _scene(raw=not first) as scene:
        steps = list(_first_steps(scene) if first else _steps(scene))
        for number, name in enumerate(_run_all(steps, processes, first=first), 1):
            tell(name, number, len(steps))
    for done in {True, first}:
        if mark := _mark(first=done):
            with suppress(OSError):  # a folder that nobody may write into serves those who read it
                mark.touch()


def _run_all(steps: list[Step], processes: int, *, first: bool) -> Iterator[str]:
    """Names of the steps as they end."""
    if processes < 2:
        for name, run in steps:
            run()
            yield name
        return
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap_unordered(partial(_run_one, first=first), range(len(steps)))
        pool.close()  # processes that are killed, as the end of ``with`` does, leave their folder behind
        pool.join()


def _run_one(number: int, *, first: bool) -> str:
    name, run = _steps_of_this_process(first=first)[number]
    run()
    return name


@cache
def _steps_of_this_process(*, first: bool) -> list[Step]:
    """The steps on a scene of the process's own, which lasts as long as it does."""
    scene = _LASTING.enter_context(_scene(raw=not first))
    return list(_first_steps(scene) if first else _steps(scene))


def is_compiled(*, first: bool = False) -> bool:
    """Whether all, or with ``first`` what most drives need, was compiled from this code for such a processor."""
    mark = _mark(first=first)
    return mark is not None and mark.exists()


def can_be_kept() -> bool:
    """Whether machine code can be written where others find it."""
    mark = _mark(first=True)
    return mark is not None and os.access(mark.parent, os.W_OK)


def load() -> None:
    """Load the machine code that most drives need into this process, for those that are forked from it.

    Nothing here starts a thread that a fork would lose, and none of OpenMP, whose loops no forked process may enter.
    """
    with _scene(raw=False, csv=False) as scene:
        for _, run in _first_steps(scene):
            run()


@contextmanager
def _scene(*, raw: bool = True, csv: bool = True) -> Iterator[Scene]:
    town = make_town(1)
    drive = simulate_drive(town, 5, DURATION_S)
    with tempfile.TemporaryDirectory(prefix="versant-") as name:
        folder = Path(name)
        write_dem(town, folder / "dem.tif")
        write_ubx(drive, folder / "drive.ubx")
        logs = [read_log(folder / "drive.ubx")]
        if csv:
            write_csv(drive, folder / "drive.csv")
            logs.append(read_log(folder / "drive.csv"))  # which starts threads of Arrow
        with Dem.open([folder / "dem.tif"]) as dem:
            yield Scene(logs, _raw_logs(drive, folder) if raw else [], town.roads, dem)


def _raw_logs(drive: SimulatedDrive, folder: Path) -> list[DriveLog]:
    """Raw signals in both of the formats that have loops of their own."""
    rinex, ubx = (folder / "drive.rnx", folder / "brdc.rnx"), folder / "raw.ubx"
    measured = canyon_of(drive).raw()
    write_ubx(drive, ubx, measured)
    rinex[0].write_text(observations(measured.signals))
    rinex[1].write_text(navigation(measured.navigation))
    return [read_logs(rinex), read_log(ubx)]


def _first_steps(scene: Scene) -> Iterator[Step]:
    """What a drive without further wishes goes through, and what is solved after it.

    What needs no drive comes first: where two processes share the work, the other one finds it compiled.
    """

    def estimate_and_solve() -> None:
        drives = [run_drive(log, scene.roads, scene.dem) for log in scene.logs]
        solve(drives, scene.roads, scene.dem, gaps=True)

    def smooth_and_solve() -> None:
        for states in range(1, STATES + 1, LANES):
            one = {(state, state): np.ones(2) for state in range(states)}
            start, seen = (np.zeros(states), np.eye(states)), (np.zeros(1, np.int64), np.ones((1, states)))
            LinearModel(2, one, one, *start, *seen, np.zeros(1), np.ones(1)).smooth()
        equations = NormalEquations.of(scipy.sparse.csc_matrix([[2.0, 1.0], [1.0, 2.0]]))
        equations.solve(np.ones(2))
        equations.covariance(np.array([[0, 1]]))

    yield "smoothers and equations", smooth_and_solve
    yield DEFAULT_METHOD, estimate_and_solve


def _steps(scene: Scene) -> Iterator[Step]:
    """Each positioning and each method, with each choice of each of its options.

    All choices of one are one step, and what shares few loops with the step before comes next: two processes that are
    at steps which share many would compile these both.
    """
    yield from _first_steps(scene)
    for name, positioning in POSITIONINGS.items():
        yield f"positions by {name}", partial(_run_positioning, scene, name, positioning.options_model)
    for name, method in METHODS.items():
        yield name, partial(_run_method, scene, name, method.options_model)
    for name in POSITIONINGS:
        yield f"{DEFAULT_METHOD} on positions by {name}", partial(_run_on_positions, scene, name)


def _run_method(scene: Scene, name: str, model: type[BaseModel]) -> None:
    for options in _choices(model):
        _run(scene.logs[-1], scene, name, options)


def _run_positioning(scene: Scene, name: str, model: type[BaseModel]) -> None:
    for options in _choices(model):
        with suppress(FusionError):
            positions_of(
                scene.raw[-1], parse_options(DEFAULT_METHOD, {"gnss": name, "gnss_options": options})
            )


def _run_on_positions(scene: Scene, name: str) -> None:
    for log in scene.raw:
        _run(
            log, scene, DEFAULT_METHOD, {"gnss": name, "gnss_options": _few(POSITIONINGS[name].options_model)}
        )


def _run(log: DriveLog, scene: Scene, method: str, options: Mapping[str, Any]) -> None:
    with suppress(FusionError):  # what it went through is compiled, and a test sees that all go to their end
        run_drive(log, scene.roads, scene.dem, method=method, options=options)


def _few(model: type[BaseModel]) -> dict[str, Any]:
    return {name: value for name, value in FEW.items() if name in model.model_fields}


def _choices(model: type[BaseModel]) -> Iterator[dict[str, Any]]:
    """Options of a model: those by default, then each choice of each option that has several."""
    few = _few(model)
    yield few
    for name, schema in model.model_json_schema().get("properties", {}).items():
        values = (True, False) if schema.get("type") == "boolean" else schema.get("enum", ())
        if name not in _ELSEWHERE:
            yield from (few | {name: value} for value in values if value != schema.get("default"))


@cache
def _mark(*, first: bool) -> Path | None:
    """The file that says so: of this code, these versions and such a processor; None where nothing can be kept."""
    folder = cache_folder(project_point)
    if folder is None:
        return None
    digest = hashlib.sha256()
    for source in sorted(Path(fusion.__path__[0]).rglob("*.py")):
        digest.update(source.read_bytes())
    for fact in (
        platform.python_version(),
        version("numba"),
        get_host_cpu_name(),
        get_host_cpu_features().flatten(),
    ):
        digest.update(fact.encode())
    return folder / f"compiled-{'first' if first else 'all'}-{digest.hexdigest()[:16]}"


def _tell(name: str, number: int, of: int) -> None:
    end = "\r" if sys.stderr.isatty() and number < of else "\n"
    if end == "\r" or number in {1, of} or number % 10 == 0:
        line = spoken(say("compile.at", n=number, all=of, name=f"{name:40}"))
        print(line, end=end, file=sys.stderr, flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
