"""Every registered method on the precisely surveyed drives of DATA_DIR: accuracy, coverage, calibration, time.

Logs are made by ``roadtruth.py`` with profile m8 at 1 Hz, one a seed, whole and with 40 s without GNSS from the 60th
second. Scores are those of ``slope_accuracy.py``, every method with its default options, one drive each.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from accuracy.scoring import Errors
from accuracy.sequences import Sequence as Road
from accuracy.sequences import estimate, find_sequences, load_tool, make_log, tool_beside
from fusion.catalogue import METHODS
from fusion.types import Progress
from published.rows import Row

SEQUENCES = ("09", "10")
CUTS: dict[str, list[str] | None] = {"": None, ", 40 s without GNSS": ["60:40"]}
_QUANTITIES = (
    ("RMSE", "%"),
    ("coverage", "%"),
    ("within 1.96 sigma", "%"),
    ("time", "s"),
)
Values = dict[str, list[float]]


def run(seeds: int, progress: Progress, data_dir: Path, roadtruth: Path | None = None) -> list[Row]:
    """Scores of every method, by sequence, whole and cut."""
    tool = load_tool(roadtruth or tool_beside(data_dir))
    sequences = [s for s in find_sequences(data_dir) if s.name in SEQUENCES]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        todo = [(sequence, cut) for sequence in sequences for cut in CUTS]
        for k, (sequence, cut) in enumerate(todo):
            logs = [make_log(tool, sequence, seed, Path(folder), "m8", CUTS[cut]) for seed in range(seeds)]
            for j, method in enumerate(METHODS):
                progress("methods", (k + j / len(METHODS)) / len(todo))
                rows += _rows(
                    f"Methods on karlsruhe {sequence.name}{cut}", method, _scores(sequence, logs, method)
                )
    return rows


def _scores(sequence: Road, logs: Sequence[Path], method: str) -> Values:
    """Each quantity, one value a log."""
    values: Values = {quantity: [] for quantity, _ in _QUANTITIES}
    for log in logs:
        begin = time.perf_counter()
        slopes = estimate(sequence, [log], method)
        values["time"].append(time.perf_counter() - begin)
        errors = Errors.of(sequence.truth, slopes)
        values["RMSE"].append(errors.rmse if len(errors) else float("nan"))
        values["coverage"].append(100 * errors.coverage)
        values["within 1.96 sigma"].append(100 * errors.within_95 if len(errors) else float("nan"))
    return values


def _rows(experiment: str, method: str, values: Values) -> Iterator[Row]:
    for quantity, unit in _QUANTITIES:
        yield Row(experiment, f"{method}: {quantity}", unit, "", values[quantity])
