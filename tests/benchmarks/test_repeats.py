"""The same road driven twice: what is left of the logs of a row, and that both drives stand for themselves."""

from __future__ import annotations

import json
import sys
from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import repeats
from accuracy.logs import POSITIONS, only, read_columns, with_barometer, write_columns
from accuracy.streets import drive_along, make_hills
from fusion.registry import DEFAULT_METHOD
from fusion.simulate.write.csv_file import csv_columns

STREET = make_hills(600.0, 100.0)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Two drives along a street, with the phone's columns."""
    folder = tmp_path / "repeats"
    folder.mkdir()
    for seed, name in enumerate(repeats.PHONE):
        drive = drive_along(STREET, seed)
        columns = csv_columns(drive)
        log = only(columns, POSITIONS) | {"height_ell_m": columns["alt_msl_m"], "v_acc_m": columns["v_acc_m"]}
        log = with_barometer(log, drive.truth.z_m, np.random.default_rng(seed))
        write_columns(log, folder / f"{name}.csv")
    return folder


def score(args: Any) -> None:
    """As the tool prints it, of the first segments."""
    one, other = (
        json.loads(Path(file).read_text())["features"][0]["properties"] for file in (args.first, args.second)
    )
    rms = one["slope_percent"] - other["slope_percent"]
    sys.stdout.write(json.dumps({"segments": 2, "rms": rms, "expected": 2.0}))


def test_each_row_drops_its_columns_and_compares_two_drives(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tool = SimpleNamespace(score=score, roads=None)
    monkeypatch.setattr(repeats, "load_tool", lambda path: tool)
    monkeypatch.setattr(repeats.Setup, "roads", lambda self, pair: STREET.roads)
    monkeypatch.setattr(
        repeats, "EXTRA", {"phone: pressure beside the first day": lambda setup: {"rms": 7.0}}
    )
    args = Namespace(data_dir=data, repeats=None, method=DEFAULT_METHOD, only="phone: pressure")
    rows = repeats.run(args, tmp_path)
    assert [row["pair"] for row in rows] == ["phone: pressure", "phone: pressure beside the first day"]
    assert rows[1]["rms"] == 7.0
    assert rows[0]["rms"] != 0.0
    assert rows[0]["ratio"] == rows[0]["rms"] / 2.0
    for name in repeats.PHONE:
        assert set(read_columns(tmp_path / f"{name}.csv")) == {*POSITIONS, "pressure_hpa"}
        assert "height_ell_m" in read_columns(data / f"{name}.csv")
    args.only = "bicycle"
    with pytest.raises(SystemExit, match="no row holds 'bicycle'"):
        repeats.run(args, tmp_path)


def test_altitude_and_pressure_are_taken_away_one_at_a_time() -> None:
    left = {name: pair.without for name, pair in repeats.PAIRS.items()}
    assert left["phone: altitude and pressure"] == ()
    assert left["phone: altitude"] == ("pressure_hpa",)
    assert "pressure_hpa" not in left["phone: pressure"]
    assert {pair.first for name, pair in repeats.PAIRS.items() if name.startswith("black box")} == {"nds-15"}
