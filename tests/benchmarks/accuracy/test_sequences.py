"""Where the benchmarks find roads with known slopes, and the logs that they have made over them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accuracy.arguments import numbers
from accuracy.logs import read_columns
from accuracy.sequences import (
    NOISE_FREE,
    find_sequences,
    folder_of,
    load_tool,
    make_log,
    road_file,
    tool_beside,
)

SEQUENCES = {"00": "roads_00.osm", "09": "roads_09_10.osm", "10": "roads_09_10.osm"}
"""Sequence -> its roads: those that tests speak of. There may be any others beside them, today or tomorrow."""


@pytest.fixture
def known(karlsruhe: Path, tmp_path: Path) -> Path:
    """A folder with these sequences and no other."""
    folder = tmp_path / "known"
    folder.mkdir()
    tracks = (f"{kind}_{name}.csv" for name in SEQUENCES for kind in ("ref", "truth"))
    for name in {*tracks, *SEQUENCES.values(), "N48E008.hgt", "N49E008.hgt"}:
        (folder / name).symlink_to(karlsruhe / name)
    return folder


def test_drives_may_be_several_numbers() -> None:
    assert numbers("1,10,40") == [1, 10, 40]
    assert numbers("7") == [7]


def test_the_road_file_of_a_sequence_names_it(tmp_path: Path) -> None:
    for name in ("roads_00.osm", "roads_09_10.osm"):
        (tmp_path / name).touch()
    assert road_file(tmp_path, "10").name == "roads_09_10.osm"
    with pytest.raises(SystemExit, match="no road file whose name holds '1'"):
        road_file(tmp_path, "1")


def test_a_folder_is_named_or_holds_the_one_asked_for(tmp_path: Path) -> None:
    inner = tmp_path / "nagoya"
    inner.mkdir()
    assert folder_of(tmp_path, "nagoya") == inner
    assert folder_of(inner, "nagoya") == inner
    with pytest.raises(SystemExit, match="holds no folder 'storuman'"):
        folder_of(tmp_path, "storuman")


def test_a_tool_that_is_missing_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match=r"name roadtruth\.py by --roadtruth"):
        load_tool(tmp_path / "roadtruth.py")


def test_the_log_without_noise_is_the_same_drive(karlsruhe: Path, known: Path, tmp_path: Path) -> None:
    path = tool_beside(karlsruhe)
    if not path.exists():
        pytest.skip("roadtruth.py (../shared/tools) is not on this machine")
    tool = load_tool(path)
    sequence = next(s for s in find_sequences(known) if s.name == "10")
    noisy, clean = (read_columns(make_log(tool, sequence, 3, tmp_path, p)) for p in ("f9p", NOISE_FREE))
    assert np.array_equal(noisy["time_s"], clean["time_s"])
    speed = np.hypot(clean["vel_n_mps"], clean["vel_e_mps"])
    climb = np.diff(clean["alt_msl_m"]) / np.diff(clean["time_s"])
    middle = -(clean["vel_d_mps"][1:] + clean["vel_d_mps"][:-1]) / 2
    assert np.std(climb - middle) < 0.05  # by the road's unevenness; f9p's heights alone would make it 0.14
    assert np.std(noisy["alt_msl_m"] - clean["alt_msl_m"]) > 0.05
    assert (clean["v_acc_m"] == 0.01).all()
    assert speed.max() > 5


def test_every_sequence_knows_its_truth_and_roads(known: Path) -> None:
    found = {s.name: s for s in find_sequences(known)}
    assert list(found) == list(SEQUENCES)
    for sequence in found.values():
        assert sequence.dem is not None
        assert sequence.log is None
        columns = (sequence.roads.osm_way_id, sequence.roads.from_node, sequence.roads.to_node)
        assert set(sequence.truth) <= set(zip(*(c.tolist() for c in columns), strict=True))
