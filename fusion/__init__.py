"""Versant's estimation library: vehicle logs, roads and terrain in; road slopes with their uncertainty out.

Arrays in, estimates out. Nothing here knows a web, a database or an environment variable, and nothing
here imports ``app``. What a notebook or a script needs is offered here by name::

    import fusion

    roads = fusion.read_roads("karlsruhe.osm.pbf")
    dem = fusion.Dem.open(["N48E008.hgt"])
    drives = [fusion.run_drive(fusion.read_log(path), roads, dem) for path in ("monday.ubx", "tuesday.gpx")]
    segments = fusion.segments_frame(fusion.solve(drives, roads, dem))

Each name is loaded when it is first asked for: ``import fusion`` itself takes no time.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fusion.formats import read_log as read_log
    from fusion.formats import read_logs as read_logs
    from fusion.pipeline import run_drive as run_drive
    from fusion.results import Solution as Solution
    from fusion.results import segments_frame as segments_frame
    from fusion.results import solve as solve
    from fusion.results import track_frame as track_frame
    from fusion.roads.osm import read_roads as read_roads
    from fusion.terrain.dem import Dem as Dem

__version__ = "0.2.0"
"""The one place of the version: pyproject.toml and ``app.core.version`` take it from here."""

HOMES = {
    "Dem": "fusion.terrain.dem",
    "Solution": "fusion.results",
    "read_log": "fusion.formats",
    "read_logs": "fusion.formats",
    "read_roads": "fusion.roads.osm",
    "run_drive": "fusion.pipeline",
    "segments_frame": "fusion.results",
    "solve": "fusion.results",
    "track_frame": "fusion.results",
}
"""The names that are offered here, and where each is at home."""

if not TYPE_CHECKING:  # a checker knows the names above, and refuses all others

    def __getattr__(name: str) -> Any:
        if name not in HOMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(HOMES[name]), name)
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *HOMES})
