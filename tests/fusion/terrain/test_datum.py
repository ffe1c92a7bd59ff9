"""What heights refer to, in words."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.terrain.datum import (
    CONTROL,
    ELLIPSOID,
    MEAN_SEA_LEVEL,
    STANDARD_ATMOSPHERE,
    datum_of_log,
    datum_of_network,
)
from fusion.types import DriveLog, GnssFix, Pressure


def log(level: int, ellipsoid: int, pressure: int = 0) -> DriveLog:
    """A log with so many heights of either kind in ten fixes."""
    time = np.arange(10.0)
    fix = GnssFix.assemble(
        time,
        lat_deg=np.full(10, 49.0),
        lon_deg=np.full(10, 8.5),
        alt_msl_m=np.where(time < level, 100.0, np.nan),
        height_ell_m=np.where(time < ellipsoid, 148.0, np.nan),
    )
    return DriveLog(
        "test", fix, pressure=Pressure.assemble(time[:pressure], pressure_pa=np.full(pressure, 1e5))
    )


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (log(10, 10), MEAN_SEA_LEVEL),
        (log(3, 10), ELLIPSOID),
        (log(0, 10, 5), ELLIPSOID),
        (log(0, 0, 5), STANDARD_ATMOSPHERE),
        (log(0, 0), None),
    ],
)
def test_a_log_refers_to_what_more_of_its_fixes_do(one: DriveLog, said: str | None) -> None:
    assert datum_of_log(one) == said


def test_a_network_says_what_its_parts_say() -> None:
    assert datum_of_network([], None) is None
    assert datum_of_network([None], None) is None
    assert (
        datum_of_network([None, MEAN_SEA_LEVEL, MEAN_SEA_LEVEL, STANDARD_ATMOSPHERE], None) == MEAN_SEA_LEVEL
    )
    assert datum_of_network([STANDARD_ATMOSPHERE], None) == STANDARD_ATMOSPHERE
    assert datum_of_network([None, STANDARD_ATMOSPHERE], "EGM96") == "the elevation model's datum (EGM96)"
    mixed = datum_of_network([ELLIPSOID, MEAN_SEA_LEVEL], "EGM96")
    assert mixed == f"no single datum, for the logs differ: {MEAN_SEA_LEVEL}, {ELLIPSOID}"
    assert datum_of_network([None], None, control=True) == CONTROL
    assert datum_of_network([ELLIPSOID], None, control=True) == f"{CONTROL} near these, elsewhere {ELLIPSOID}"
