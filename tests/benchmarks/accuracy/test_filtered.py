"""The rows of altitudes out of a low-pass: which drives are put together, and what the bound is beside."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from accuracy import filtered
from accuracy.bounds import RoadBound
from accuracy.filtered import Drives
from accuracy.logs import Columns, read_columns, write_columns
from accuracy.scoring import Errors
from accuracy.sequences import Sequence
from accuracy.streets import make_street
from accuracy.truth import TrueSlope, Truth

TRUTH: Truth = {(1, 1, 2): TrueSlope(2.0, 20.0, 20.0)}
STREET = make_street(np.array([0.0, 20.0]), np.array([100.0, 100.4]), np.full(2, 0.02))


def drives_of(seeds: int, folder: Path, bound: ModuleType | None = None) -> Drives:
    return Drives(ModuleType("roadtruth"), bound, folder, "profile", seeds)


def road(name: str) -> Sequence:
    return Sequence(name, TRUTH, STREET.roads, None, None, None)


def test_single_drives_and_sets_of_ten(tmp_path: Path) -> None:
    few, many = drives_of(2, tmp_path).groups(), drives_of(12, tmp_path).groups()
    assert few == {1: [[0], [1]], 10: [list(range(10))]}
    assert len(many[1]) == 12
    assert many[10] == [list(range(10)), list(range(10, 20))]
    assert drives_of(12, tmp_path).all_seeds() == list(range(20))


def test_rows_are_means_over_roads_and_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def errors(self: Drives, sequence: Sequence, receiver: str, low_pass_s: float) -> dict[int, list[Errors]]:
        off = (1.0 if sequence.name == "a" else 2.0) + low_pass_s
        return {
            count: [Errors.of(TRUTH, {(1, 1, 2): (2.0 + off / count, 1.0)}) for _ in groups]
            for count, groups in self.groups().items()
        }

    monkeypatch.setattr(Drives, "errors", errors)
    monkeypatch.setattr(Drives, "bounds", lambda self, road, sequence, receiver: {1: [0.5, 0.7], 10: [0.1]})
    monkeypatch.setattr(RoadBound, "of", lambda tool, sequence: None)
    rows = filtered.filtered_rows(drives_of(2, tmp_path, ModuleType("bound")), [road("a"), road("b")])
    assert len(rows) == 2 * 2 * 4
    found = {(row["receiver"], row["drives"], row["low_pass_s"]): row for row in rows}
    assert found["m8", 1, 0.0]["rmse_percent"] == pytest.approx(1.5)
    assert found["phone", 10, 4.0]["rmse_percent"] == pytest.approx(0.55)
    assert found["m8", 1, 2.0]["bound_percent"] == pytest.approx(0.6)
    assert found["m8", 10, 2.0]["bound_percent"] == pytest.approx(0.1)
    assert found["m8", 10, 2.0]["log"] == "altitude, low-pass 2 s"
    alone = filtered.filtered_rows(drives_of(2, tmp_path), [road("a")])
    assert all(row["bound_percent"] is None for row in alone)


def test_the_logs_hold_filtered_altitudes_and_no_accuracies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Altitudes jump from 100 to 110 m half way."""
    time_s = np.arange(20.0)
    full: Columns = {
        "time_s": time_s,
        "lat_deg": np.full(20, 49.0),
        "lon_deg": np.full(20, 8.0),
        "h_acc_m": np.full(20, 2.0),
        "alt_msl_m": np.where(time_s < 10, 100.0, 110.0),
    }
    fused: list[Columns] = []

    def drive(**arguments: Any) -> None:
        write_columns(full, Path(arguments["out"]))

    def fuse(sequence: Sequence, logs: Any, method: str) -> Any:
        fused.extend(read_columns(log) for log in logs)
        return SimpleNamespace()

    monkeypatch.setattr("accuracy.sequences.quietly", lambda command, **arguments: drive(**arguments))
    monkeypatch.setattr(filtered, "fuse", fuse)
    monkeypatch.setattr(filtered, "among", lambda one, logs: one)
    monkeypatch.setattr(filtered, "slopes_of", lambda one: {})
    tool = cast(Any, SimpleNamespace(drive=None, PROFILES={}))
    sequence = Sequence("a", TRUTH, STREET.roads, None, tmp_path / "ref_a.csv", None)
    found = Drives(tool, None, tmp_path, "profile", 1).errors(sequence, "phone", 2.0)
    assert {count: len(groups) for count, groups in found.items()} == {1: 1, 10: 1}
    assert len(fused) == 10
    assert set(fused[0]) == {"time_s", "lat_deg", "lon_deg", "alt_msl_m"}
    assert fused[0]["alt_msl_m"][10] == pytest.approx(110 - 10 * np.exp(-0.5), abs=1e-3)
