#!/usr/bin/env python3
"""How near Versant comes to the limit: the information in its logs, and what is left without any noise.

    python benchmarks/limit.py DATA_DIR [--sequences 00,05,08,09,10] [--profiles m8,phone,f9p] [--drives 1,10,40]
                               [--sets 3] [--method NAME] [--bound PATH] [--json FILE]

DATA_DIR is the folder ``karlsruhe``, or the one that holds it. For each road, receiver and number of drives, means over
``--sets`` sets of drives (drive d of set s has the seed 1000 + 100 s + d), RMSE in percent of slope:

    bound      of a smoother that knows true places and noise levels, by the tool ``bound.py`` from the same logs and
               over the same segments; not of more than ten drives
    floor      of Versant on as many of the same drives without noise: sampling once a second, the line of the road on
               the map and the model of the road are left
    together   the two added up as independent errors
    Versant    with the elevation model that the data has
    ratio      Versant to both together

and Versant's share of errors within 1.96 sigma and root mean square of error over sigma, over all sets. The rows
``all`` are of the segments of all roads in one, ``whole`` of those that the reference drove as a whole: of the others
truth and bound know a part, and Versant states the slope of all.

The limit is no wall. The bound does not know the elevation model and takes the road as a random walk; the range of the
bound over four times smoother and rougher roads tells how sharp it is. Springs move the body in the floor's logs too.
"""

from __future__ import annotations

import tempfile
from argparse import Namespace
from collections.abc import Sequence as Several
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from accuracy.arguments import data_parser_of, numbers, plain_errors
from accuracy.bounds import AS_FITTED, RoadBound
from accuracy.scoring import WHOLE_SHARE, Errors, Row, rms, show_progress, text_table, write_json
from accuracy.sequences import (
    NOISE_FREE,
    RECEIVERS,
    Sequence,
    Slopes,
    among,
    find_sequences,
    folder_of,
    fuse,
    load_tool,
    make_log,
    slopes_of,
    tool_beside,
)
from fusion.registry import DEFAULT_METHOD
from fusion.types import Floats

FIRST_SEED, SEEDS_OF_A_SET = 1000, 100
MOST_BOUND_DRIVES = 10
"""With more the bound is far below the floor, and takes long."""
COLUMNS = {
    "sequence": ("road", ""),
    "receiver": ("receiver", ""),
    "drives": ("drives", "d"),
    "bound_percent": ("bound %", ".3f"),
    "bound_range": ("(4x smoother, rougher)", ""),
    "floor_percent": ("floor %", ".3f"),
    "together_percent": ("together %", ".3f"),
    "rmse_percent": ("Versant %", ".3f"),
    "ratio": ("ratio", ".2f"),
    "within_95": ("in 1.96s", ".1%"),
    "z_rms": ("z-rms", ".2f"),
}


@dataclass(frozen=True, eq=False)
class SetScore:
    """One set of drives: Versant's errors with and without noise, and the bound's on Versant's segments."""

    versant: Errors
    floor: Errors
    bound: dict[str, Floats] | None
    """By roughness, one error for each of ``versant``; None where there are too many drives."""

    def whole(self) -> SetScore:
        """The segments that the reference drove as a whole."""
        mine, clean = (one.driven_share >= WHOLE_SHARE for one in (self.versant, self.floor))
        bound = None if self.bound is None else {name: of[mine] for name, of in self.bound.items()}
        return SetScore(self.versant.take(mine), self.floor.take(clean), bound)


@dataclass
class Road:
    """One road, with what is the same for all its receivers."""

    sequence: Sequence
    bound: RoadBound
    folder: Path
    method: str

    def slopes(self, receiver: str, drives: Several[int], sets: int) -> dict[tuple[int, int], Slopes]:
        """Versant's slopes by number of drives and set; each log is fused once."""
        logs = {
            number: [self.log(receiver, number, drive) for drive in range(max(drives))]
            for number in range(sets)
        }
        fused = fuse(self.sequence, [log for of_set in logs.values() for log in of_set], self.method)
        return {
            (count, number): slopes_of(among(fused, logs[number][:count]))
            for count in drives
            for number in range(sets)
        }

    def log(self, receiver: str, number: int, drive: int) -> Path:
        """The log of one drive of a set."""
        return make_log(self.bound.tool.rt, self.sequence, seed_of(number, drive), self.folder, receiver)

    def bounds(self, receiver: str, drives: Several[int], sets: int) -> dict[tuple[int, int], dict[str, Any]]:
        """The bound's errors by segment for each roughness, by number of drives and set."""
        few = [count for count in drives if count <= MOST_BOUND_DRIVES]
        found = {}
        for number in range(sets if few else 0):
            observed = [
                self.bound.drive(self.log(receiver, number, drive), receiver, seed_of(number, drive))
                for drive in range(max(few))
            ]
            for count in few:
                show_progress(
                    f"{self.sequence.name}, {receiver}: bound of {count} drive(s), set {number + 1}"
                )
                found[count, number] = self.bound.errors(observed[:count])
        return found

    def scores(
        self, receiver: str, drives: Several[int], sets: int, floor: dict[tuple[int, int], Slopes]
    ) -> dict[int, list[SetScore]]:
        """The sets by number of drives."""
        show_progress(f"{self.sequence.name}, {receiver}: Versant")
        slopes = self.slopes(receiver, drives, sets)
        bounds = self.bounds(receiver, drives, sets)
        truth = self.sequence.truth
        out: dict[int, list[SetScore]] = {count: [] for count in drives}
        for (count, number), estimates in slopes.items():
            there = np.array([key in estimates for key in self.bound.keys], bool)
            bound = bounds.get((count, number))
            out[count].append(
                SetScore(
                    Errors.of(truth, estimates),
                    Errors.of(truth, floor[count, number]),
                    None if bound is None else {name: of[there] for name, of in bound.items()},
                )
            )
        return out


def seed_of(number: int, drive: int) -> int:
    """The seed of a drive of a set, as ``bound.py`` has it."""
    return FIRST_SEED + SEEDS_OF_A_SET * number + drive


def pooled(roads: Several[SetScore]) -> SetScore:
    """The segments of several roads in one."""
    bounds = [road.bound for road in roads if road.bound is not None]
    return SetScore(
        Errors.pooled([road.versant for road in roads]),
        Errors.pooled([road.floor for road in roads]),
        {name: np.concatenate([of[name] for of in bounds]) for name in bounds[0]}
        if len(bounds) == len(roads)
        else None,
    )


def row_of(sets: Several[SetScore]) -> Row:
    """The figures of sets of drives: RMSE are means over the sets, shares of all errors."""
    versant = Errors.pooled([one.versant for one in sets])
    floor = float(np.mean([one.floor.rmse for one in sets]))
    mine = float(np.mean([one.versant.rmse for one in sets]))
    row: Row = {
        "floor_percent": floor,
        "rmse_percent": mine,
        "coverage": versant.coverage,
        "within_95": versant.within_95,
        "z_rms": versant.z_rms,
    }
    bounds = [one.bound for one in sets if one.bound is not None]
    if len(bounds) < len(sets):
        return row
    of = {name: float(np.mean([rms(bound[name]) for bound in bounds])) for name in bounds[0]}
    together = float(np.hypot(of[AS_FITTED], floor))
    smoother, rougher = (of[name] for name in (f"{AS_FITTED}/4", f"4{AS_FITTED}"))
    return row | {
        "bound_percent": of[AS_FITTED],
        "bound_smoother_percent": smoother,
        "bound_rougher_percent": rougher,
        "bound_range": f"({smoother:.3f}, {rougher:.3f})",
        "together_percent": together,
        "ratio": mine / together,
    }


def run(args: Namespace, data: Path, tool: ModuleType, folder: Path) -> list[Row]:
    """Every road with every receiver, then all roads together."""
    sequences = find_sequences(data, names=args.sequences)
    receivers = args.profiles.split(",")
    scores: dict[tuple[str, int], dict[str, list[SetScore]]] = {}
    for sequence in sequences:
        road = Road(sequence, RoadBound.of(tool, sequence), folder, args.method)
        show_progress(f"{sequence.name}: Versant without noise")
        floor = road.slopes(NOISE_FREE, args.drives, args.sets)
        for receiver in receivers:
            for count, sets in road.scores(receiver, args.drives, args.sets, floor).items():
                scores.setdefault((receiver, count), {})[sequence.name] = sets
    show_progress("")
    keys = [(receiver, count) for receiver in receivers for count in args.drives]
    rows = [
        {"sequence": s.name, "receiver": receiver, "drives": count, **row_of(scores[receiver, count][s.name])}
        for s in sequences
        for receiver, count in keys
    ]
    for receiver, count in keys if len(sequences) > 1 else []:
        together = [pooled(of_set) for of_set in zip(*scores[receiver, count].values(), strict=True)]
        for name, sets in (("all", together), ("whole", [one.whole() for one in together])):
            rows.append({"sequence": name, "receiver": receiver, "drives": count, **row_of(sets)})
    return rows


def main() -> None:
    """Parse the command line, run, print."""
    parser = data_parser_of(__doc__, tool="bound")
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--sequences", default="00,05,08,09,10")
    parser.add_argument("--profiles", default=",".join(RECEIVERS), help="receivers, separated by commas")
    parser.add_argument(
        "--drives", type=numbers, default=[1, 10, 40], metavar="N[,N...]", help="drives in a set"
    )
    parser.add_argument("--sets", type=int, default=3, help="sets of drives (default 3)")
    args = parser.parse_args()
    data = folder_of(args.data_dir, "karlsruhe")
    tool = load_tool(args.bound or tool_beside(data, "bound.py"))
    with plain_errors(), tempfile.TemporaryDirectory() as folder:
        rows = run(args, data, tool, Path(folder))
    print(text_table(rows, COLUMNS))
    write_json(args.json, rows)


if __name__ == "__main__":
    main()
