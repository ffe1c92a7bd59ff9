"""Medians of rows over scenes."""

from __future__ import annotations

import numpy as np

from routers.errors import Errors, median_rows


def test_medians_are_of_rows_of_one_name_and_the_worst_share_is_kept() -> None:
    where = {"decks": np.array([True, False, False])}
    scenes = [
        Errors(np.full(3, before), np.full(3, after), where, np.ones(3, bool)).rows("height")
        for before, after in ((2.0, 1.0), (4.0, 1.0), (3.0, 0.3))
    ]
    rows = {row["where"]: row for row in median_rows(scenes)}
    assert list(rows) == ["all", "decks", "all, unmeasured too"]
    assert rows["decks"] == {"what": "height", "where": "decks", "n": 1, "before": 3.0, "after": 1.0, "left": 0.25,
                             "most_left": 0.5}  # fmt: skip
    assert rows["all"]["n"] == 3
