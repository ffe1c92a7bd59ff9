"""A picture of the Calais-like scene: its roads with the estimated track, and heights along the drive."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from published.particle.calais import CASES, RECEIVER
from published.particle.calais_measure import Estimated, Scene, estimate

SEED = 1
_COLOURS = {
    "motorway": ("#20262b", 1.8),
    "motorway_link": ("#3b6ea5", 1.3),
    "tertiary": ("#8a8f94", 0.9),
    "residential": ("#b9bdc1", 0.7),
}
_TRACK, _TRUTH, _GROUND = "#d1495b", "#20262b", "#e0b040"


def draw(path: Path) -> None:
    """Draw one seed with the thesis's chapter 3 and Doppler, by its Kalman filter, as a PNG."""
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene.make(SEED, RECEIVER, Path(folder))
        case = CASES[2]
        estimated = estimate(scene, case.method, {**case.options, "filter": "ekf"}, case.raster)
        figure = Figure(figsize=(9.0, 9.4), layout="constrained")
        board, profile = figure.subplots(2, 1, height_ratios=(3.2, 1.0))
        _draw_map(board, scene, estimated)
        _draw_heights(profile, scene, estimated, case.raster)
    FigureCanvasAgg(figure).print_figure(path, dpi=80)


def _draw_map(axes: Axes, scene: Scene, estimated: Estimated) -> None:
    town, track = scene.town, estimated.result.track
    for highway, (colour, width) in _COLOURS.items():
        of = np.flatnonzero(town.roads.highway == highway)
        ends = np.stack(
            [np.column_stack([town.node_x_m[k], town.node_y_m[k]]) for k in (town.start[of], town.end[of])],
            axis=1,
        )
        axes.add_collection(LineCollection(list(ends), colors=colour, linewidths=width, label=highway))
    x, y = town.projection.to_xy(track.lon_deg, track.lat_deg)
    axes.plot(x, y, ".", color=_TRACK, markersize=3.0, label="estimate, one a second")
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.legend(loc="upper left", fontsize=8, framealpha=1.0)


def _draw_heights(axes: Axes, scene: Scene, estimated: Estimated, raster: str) -> None:
    track, drive = estimated.result.track, scene.drive
    truth = drive.motion.at(track.time_s - drive.start_time_s)
    ground = scene.dems[raster].heights(track.lon_deg, track.lat_deg)
    bias = float(np.mean(track.alt_m - truth.z_m))
    t = track.time_s - track.time_s[0]
    axes.plot(
        t, ground - np.mean(ground - truth.z_m), color=_GROUND, linewidth=0.8, label="DEM, mean error off"
    )
    axes.plot(t, truth.z_m, color=_TRUTH, linewidth=1.6, label="road")
    axes.plot(
        t, track.alt_m - bias, color=_TRACK, linewidth=1.0, label=f"estimate, mean error of {bias:.1f} m off"
    )
    axes.set_xlabel("time, s")
    axes.set_ylabel("height, m")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8, ncols=3, frameon=False)
