"""The ablation of constants on one short drive: the model as it is first, each change beside it."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import pytest

import ablation
from fusion.network import segment_slopes


def arguments(karlsruhe: Path, **changes: object) -> Namespace:
    usual = {
        "data_dir": karlsruhe, "roadtruth": None, "sequences": "10", "seeds": 1, "profile": "m8",
        "only": "PLACE_SIGMA_M", "log": "everything",
    }  # fmt: skip
    return Namespace(**(usual | changes))


@pytest.mark.slow
def test_a_row_for_each_change_beside_the_model_as_it_is(karlsruhe: Path) -> None:
    before = segment_slopes.PLACE_SIGMA_M
    rows = ablation.of_constants(arguments(karlsruhe))
    assert [row["constant"] for row in rows] == [
        "(as it is)", "PLACE_SIGMA_M off: 0", "PLACE_SIGMA_M halved", "PLACE_SIGMA_M doubled",
    ]  # fmt: skip
    assert rows[0]["worse_1"] == rows[0]["worse_10"] == 0
    # The place of the map's nodes is in the sigmas and nowhere else.
    for row in rows[1:]:
        assert row["rmse_percent_1"] == pytest.approx(rows[0]["rmse_percent_1"], rel=1e-6)
    assert rows[1]["z_rms_10"] > rows[0]["z_rms_10"] > rows[3]["z_rms_10"]
    assert set(rows[0]["sequences"]) == {"10"}
    assert before == segment_slopes.PLACE_SIGMA_M


@pytest.mark.slow
def test_what_drives_hold_already_is_made_anew(karlsruhe: Path) -> None:
    usual, off = ablation.of_constants(arguments(karlsruhe, only="LOG_WANDER off"))
    assert off["z_rms_1"] > 1.02 * usual["z_rms_1"]


def test_a_constant_that_is_not_there_is_said_with_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(SystemExit, match="PLACE_SIGMA_M halved"):
        ablation.of_constants(arguments(tmp_path, only="nothing of the kind"))
