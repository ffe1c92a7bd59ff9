"""Errors of grades with one model and with another, and where they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accuracy.scoring import rms
from fusion.types import Bools, Floats

Rows = list[dict[str, Any]]


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of n grades with either model, percent; which are where, and which were measured."""

    before: Floats
    after: Floats
    where: Mapping[str, Bools]
    measured: Bools

    def rows(self, what: str) -> Rows:
        """Their root mean squares."""
        places = {"all": np.ones(len(self.before), bool), **self.where}
        known = np.isfinite(self.before) & np.isfinite(self.after)
        found = []
        for name, here in {**{f"{name}": w & self.measured for name, w in places.items()},
                           "all, unmeasured too": places["all"]}.items():  # fmt: skip
            mine = here & known
            if mine.any():
                before, after = rms(self.before[mine]), rms(self.after[mine])
                found.append({"what": what, "where": name, "n": int(mine.sum()), "before": before, "after": after,
                              "left": after / before})  # fmt: skip
        return found


def median_rows(scenes: Sequence[Rows]) -> Rows:
    """Medians over scenes of rows of the same name, and the largest share that is left of any scene."""
    by_name: dict[tuple[str, str], Rows] = {}
    for row in (row for rows in scenes for row in rows):
        by_name.setdefault((row["what"], row["where"]), []).append(row)
    return [
        {"what": what, "where": where, "n": round(float(np.median([row["n"] for row in rows]))),
         **{name: float(np.median([row[name] for row in rows])) for name in ("before", "after", "left")},
         "most_left": max(row["left"] for row in rows)}
        for (what, where), rows in by_name.items()
    ]  # fmt: skip


class Collected:
    """Grades, one after the other: the true ones, those of both models, and where they are."""

    def __init__(self) -> None:
        self.true: list[Sequence[float]] = []
        self.found: tuple[list[Sequence[float]], list[Sequence[float]]] = ([], [])
        self.facts: list[tuple[bool, bool, bool, bool]] = []
        self.places: list[list[float]] = []
        self.runs_m: list[float] = []

    def errors(self, column: int) -> Errors:
        """Of one kind of grade."""
        true, before, after = (np.array(one, float)[:, column] for one in (self.true, *self.found))
        measured, deck, beside, banked = np.array(self.facts, bool).T
        where = {
            "bridges and tunnels": deck,
            "beside them": beside & ~deck,
            "banks and cuttings": banked & ~deck,
        }
        return Errors(before - true, after - true, where, measured)
