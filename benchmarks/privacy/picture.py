"""A map of one drive: where it went, and what was named of it on the live map and from editions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from fusion.types import Bools, Floats, Ints
from privacy.attacks import Names
from privacy.city import City
from privacy.scoring import f1_scores

SIZE_INCHES = (15.0, 5.4)


def draw(city: City, true: Sequence[Ints], told: Bools, named: dict[str, Names], path: Path) -> None:
    """The drive of middling length, and of each kind of names the one that is nearest to it."""
    lengths = np.array([city.metres(rows) for rows in true])
    one = int(np.argsort(lengths)[len(lengths) // 2])
    figure = Figure(SIZE_INCHES, layout="constrained")
    FigureCanvasAgg(figure)
    panels = {
        "the drive": true[one],
        **{name: _nearest(city, n.drives, true[one]) for name, n in named.items()},
    }
    for axes, (name, rows) in zip(figure.subplots(1, len(panels)), panels.items(), strict=True):
        axes.add_collection(LineCollection(_lines(city, city.rows), colors="#dddddd", linewidths=0.5))
        axes.add_collection(
            LineCollection(_lines(city, np.flatnonzero(told)), colors="#9db8d6", linewidths=1.0)
        )
        axes.add_collection(LineCollection(_lines(city, rows), colors="#c0392b", linewidths=2.2))
        axes.autoscale()
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(name)
    figure.savefig(path, dpi=100)


def _nearest(city: City, drives: Sequence[Ints], true: Ints) -> Ints:
    scores = f1_scores([true], drives, city.length_m).toarray()[0]
    return drives[int(scores.argmax())] if len(drives) else np.empty(0, np.int64)


def _lines(city: City, rows: Ints) -> list[Floats]:
    """From where to where each row goes, (2, 2) each, m."""
    return list(np.stack([city.place[city.start[rows]], city.place[city.end[rows]]], axis=1))
