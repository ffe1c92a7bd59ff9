"""The made-up archive: every form is a log of the same drive, and what is broken is none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from batch.logs import BROKEN, FORMS, make_broken, make_log
from fusion.errors import LogError
from fusion.formats import read_log
from fusion.simulate.scene.town import make_town


def test_each_form_is_read_as_what_it_is(tmp_path: Path) -> None:
    roads = make_town(1).roads
    made = [make_log(roads, seed, 400.0, tmp_path) for seed in range(len(FORMS))]
    formats = [read_log(path).source_format for path in made]
    assert formats == ["csv", "gpx", "csv", "nmea", "csv", "gpx"]
    for path in made:
        log = read_log(path)
        assert len(log.fix) > 20, path
        assert np.isfinite(log.fix.alt_msl_m).all(), path
    late = read_log(made[-1]).fix.alt_msl_m
    assert np.allclose(late / 0.2, np.round(late / 0.2), atol=1e-6), "in steps, as an altimeter's"


def test_what_is_broken_is_no_log(tmp_path: Path) -> None:
    made = make_broken(2 * len(BROKEN), tmp_path)
    assert len({path.read_bytes() for path in made}) >= len(made) - 1, (
        "but for what is empty, none like another"
    )
    for path in made:
        with pytest.raises(LogError):
            read_log(path)
