"""The table of all passes says what the passes say, in one order."""

from __future__ import annotations

import numpy as np

from fusion.network.pass_columns import PassColumns, in_order
from fusion.network.pass_factor import NUISANCES
from network_draws import driven_town

COLUMNS = ("sequence", "segment", "mount", "place", "rows", "square", "start_m", "last_time_s", "condensed")


def test_columns_are_the_passes_drive_by_drive() -> None:
    _, drives = driven_town()
    turned = {d: passes[::-1] for d, passes in sorted(drives.items(), reverse=True)}
    table = PassColumns.of(turned)
    names, passes = in_order(turned)
    assert table.drive.tolist() == names == sorted(names)
    for name in COLUMNS:
        assert getattr(table, name).tolist() == [getattr(p, name) for p in passes]
    assert table.walk_m2_per_s.tolist() == [list(p.walk_m2_per_s) for p in passes]
    assert table.used.tolist() == [p.used.tolist() for p in passes]
    assert (table.knots + NUISANCES).tolist() == [len(p.vector) for p in passes]
    for d, where in zip(*table.of_drives(), strict=True):
        assert table.sequence[where].tolist() == sorted(p.sequence for p in drives[d])


def test_parts_of_drives_are_put_together() -> None:
    _, drives = driven_town()
    parts = [{d: [p for p in passes if p.segment % 3 == k] for d, passes in drives.items()} for k in range(3)]
    found = PassColumns.together([PassColumns.of(part) for part in parts])
    whole = PassColumns.of(drives)
    for name in ("drive", *COLUMNS):
        assert np.array_equal(getattr(found, name), getattr(whole, name))


def test_no_passes_are_a_table_too() -> None:
    assert len(PassColumns.of({})) == 0
    assert PassColumns.of({}).used.shape == (0, NUISANCES)
    assert PassColumns.together([]).of_drives() == ([], [])
