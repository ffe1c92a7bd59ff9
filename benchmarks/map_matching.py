#!/usr/bin/env python3
"""Map matching against hand-corrected routes: the drive matcher, the survey's matchers and LeuvenMapMatching.

    python benchmarks/map_matching.py DATA_DIR [--methods NAME ...] [--skip-leuven] [--leuven N] [--hour]
                                      [--out DIR] [--json FILE]

DATA_DIR holds tracks of the collection of Kubicka et al. (2015), in subfolders or flat: X.track (lon lat time),
X.nodes (lon lat), X.arcs (from to, directed, 0-based), X.route (rows of arcs). Tracks 0 to 18 served for tuning and
are shown apart from the rest.

E = (missed + added) / true length, of directed arcs, by the heaviest common subsequence of the true and the matched
route: Newson & Krumm 2009, made aware of order, direction and repeats. Points per second: all raw points, by the
processor time of one thread, second pass, median over the tracks; preparing the matcher for a network is counted
apart (median seconds). ``--hour`` adds an hour of simulated driving at 10 Hz through a town (M8 receiver, positions
alone), whose true way is known: what a dense log costs.

    drive    fusion.matching.drive.DriveMatcher, default settings
    the names in fusion.published.matchers.MATCHERS, default settings
             points thinned to 14 m, the course is that of the neighbours; each point gets a segment, so that short
             arcs between two points are missed. ``mahalanobis`` is the rule of Al Assaad 2020
    drive-points
             what that alone costs: ``drive``, but only the segments of the thinned points
    leuven   LeuvenMapMatching, DistanceMatcher (thinned to 14 m, obs_noise 15, non-emitting, lattice 10, max_dist 50);
             slow, one pass; ``--leuven N`` takes the first N tracks of each part only

``--out DIR`` writes the matched arc rows of ``drive``, one a line, as X.arcs.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accuracy.arguments import parser_of
from accuracy.scoring import write_json
from fusion.matching.drive import DriveMatcher
from fusion.matching.samples import DriveSamples, thin
from fusion.published.matchers import MATCHERS
from fusion.published.matchers.base import PointMatcher, PointMatches
from fusion.roads.network import RoadNetwork
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import make_town
from fusion.types import Ints
from published.matchers import leuven
from published.matchers.tracks import Track, error, find_tracks, read_track

LAST_TUNED = 18
HOUR = "hour"
PARTS = ("0-18", "rest", HOUR)
SPACING_M = 14.0

Figures = dict[str, Any]
"""One row of a table, by column: names as text, figures as numbers."""
Result = tuple[Ints, float, float]
"""Matched arc rows, seconds of preparation, seconds of matching."""


def arc_rows(track: Track, segment: Ints, forward: NDArray[np.bool_]) -> Ints:
    """The arcs of segments as they are driven, without those that no arc allows."""
    rows = track.arc_of[segment, np.where(forward, 0, 1)]
    return rows[rows >= 0]


def second_pass(work: Callable[[], object]) -> float:
    """Seconds of this thread in the second of two calls: other programs on the machine hardly count."""
    work()
    start = time.thread_time()
    work()
    return time.thread_time() - start


def by_drive(track: Track) -> Result:
    """The matcher of the whole drive."""
    DriveMatcher(track.network)  # compiled or read from disk
    start = time.thread_time()
    matcher = DriveMatcher(track.network)
    prepared = time.thread_time() - start
    points = track.time_s, track.x_m, track.y_m
    seconds = second_pass(lambda: matcher.match(*points))
    match = matcher.match(*points)
    return arc_rows(track, match.segment, match.forward), prepared, seconds


def thinned(track: Track) -> Ints:
    """Indices of points 14 m apart."""
    drive = DriveSamples.of(track.time_s, track.x_m, track.y_m, None, None, None)
    return thin(drive, SPACING_M, np.inf, 0.0, SPACING_M)


def by_drive_points(track: Track) -> Result:
    """The path of the whole drive, of which only the segments of the thinned points are counted."""

    def match_thinned() -> tuple[Ints, NDArray[np.bool_]]:
        match = matcher.match(track.time_s, track.x_m, track.y_m)
        row = match.traversal[thinned(track)]
        return match.segment[row[row >= 0]], match.forward[row[row >= 0]]

    start = time.thread_time()
    matcher = DriveMatcher(track.network)
    prepared = time.thread_time() - start
    return arc_rows(track, *match_thinned()), prepared, second_pass(match_thinned)


def by_points(matcher: PointMatcher) -> Callable[[Track], Result]:
    """One of the survey's matchers, over points 14 m apart (else that of mahalanobis is twice as large)."""

    def matched(track: Track) -> Result:
        matcher.on(track.network)  # compiled or read from disk
        network = replace(track.network)  # a copy has no index yet
        start = time.thread_time()
        matching = matcher.on(network)
        prepared = time.thread_time() - start

        def match_thinned() -> PointMatches:
            thinned_rows = thinned(track)
            x, y = track.x_m[thinned_rows], track.y_m[thinned_rows]
            heading = np.arctan2(np.gradient(y), np.gradient(x)) if len(x) > 1 else np.full(len(x), np.nan)
            return matching(track.time_s[thinned_rows], x, y, heading)

        seconds = second_pass(match_thinned)
        match = match_thinned()
        matched = match.segment >= 0
        return arc_rows(track, match.segment[matched], match.forward[matched]), prepared, seconds

    return matched


def by_leuven(track: Track) -> Result:
    """LeuvenMapMatching."""
    rows, seconds = leuven.match(track)
    return rows, float("nan"), seconds


METHODS: dict[str, Callable[[Track], Result]] = {
    "drive": by_drive,
    "drive-points": by_drive_points,
    **{name: by_points(matcher) for name, matcher in MATCHERS.items()},
    "leuven": by_leuven,
}


def hour() -> Track:
    """An hour of driving at 10 Hz: arc 2 s is segment s forward, 2 s + 1 backward."""
    town = make_town(seed=1)
    drive = simulate_drive(town, seed=5, duration_s=3600.0, rate_hz=10.0, receiver="m8")
    x, y = (np.where(drive.has_gnss, place, np.nan) for place in (drive.gnss.x_m, drive.gnss.y_m))
    lon, lat = drive.lonlat()
    network = RoadNetwork.project(town.roads, town.projection)
    t, n = network.table, len(network)
    arcs = np.column_stack([t.from_node, t.to_node, t.to_node, t.from_node]).reshape(2 * n, 2)
    route = np.array([2 * p.segment + (0 if p.forward else 1) for p in drive.passes()])
    return Track(
        name=HOUR,
        time_s=drive.time_s,
        x_m=x,
        y_m=y,
        lat_deg=lat,
        lon_deg=lon,
        network=network,
        arc_of=np.arange(2 * n).reshape(n, 2),
        same=np.arange(2 * n),
        arc_length_m=np.repeat(network.length_m, 2),
        arcs=arcs,
        nodes_deg=np.empty((0, 2)),
        route=route,
    )


def methods_of(args: argparse.Namespace) -> list[str]:
    """The methods that are asked for and can run, in the order of ``METHODS``."""
    methods = [name for name in METHODS if name in args.methods]
    if "leuven" in methods and args.skip_leuven:
        methods.remove("leuven")
    elif "leuven" in methods and not leuven.available():
        methods.remove("leuven")
        print("leuvenmapmatching and rtree are not installed: no comparison with it", file=sys.stderr)
    return methods


def part_of(name: str) -> str:
    """Whether a track served for tuning, or is simulated."""
    if name == HOUR:
        return HOUR
    return "0-18" if name.isdigit() and int(name) <= LAST_TUNED else "rest"


def run(args: argparse.Namespace) -> list[Figures]:
    """One row per track and method."""
    paths = find_tracks(args.data_dir)
    if not paths:
        sys.exit(f"{args.data_dir}: no *.track")
    methods = methods_of(args)
    if args.out:
        args.out.mkdir(parents=True, exist_ok=True)
    rows: list[Figures] = []
    tracks_of = dict.fromkeys(PARTS, 0)
    tracks: Iterable[Track] = map(read_track, paths)
    if args.hour:
        tracks = chain([hour()], tracks)
    for number, track in enumerate(tracks):
        part = part_of(track.name)
        tracks_of[part] += 1
        for method in methods:
            if method == "leuven" and args.leuven is not None and tracks_of[part] > args.leuven:
                continue
            arcs, prepared, seconds = METHODS[method](track)
            rows.append(
                {
                    "track": track.name,
                    "part": part,
                    "method": method,
                    "error": error(track, arcs),
                    "points": len(track.time_s),
                    "points_per_s": len(track.time_s) / seconds,
                    "prepare_s": prepared,
                }
            )
            if method == "drive" and args.out:
                (args.out / f"{track.name}.arcs").write_text("".join(f"{a}\n" for a in arcs))
        if sys.stderr.isatty():
            print(f"\r{number + 1}/{len(paths) + args.hour} tracks ", end="", file=sys.stderr)
    return rows


def summarise(rows: list[Figures]) -> list[Figures]:
    """One row per part and method."""
    out: list[Figures] = []
    for part in PARTS:
        for method in METHODS:
            mine = [r for r in rows if r["part"] == part and r["method"] == method]
            if mine:
                e, speed, prepared = (
                    np.array([r[k] for r in mine], float) for k in ("error", "points_per_s", "prepare_s")
                )
                out.append(
                    {
                        "part": part,
                        "method": method,
                        "tracks": len(mine),
                        "error_median": float(np.median(e)),
                        "error_mean": float(e.mean()),
                        "points_per_s": float(np.median(speed)),
                        "prepare_s": float(np.median(prepared)),
                    }
                )
    return out


def show(summary: list[Figures]) -> None:
    """The table a person reads."""
    print(
        f"{'tracks':7} {'method':17} {'n':>3} {'E median %':>11} {'E mean %':>9} {'points/s':>11} {'prepare s':>10}"
    )
    for r in summary:
        print(
            f"{r['part']:7} {r['method']:17} {r['tracks']:3} {100 * r['error_median']:11.2f} "
            f"{100 * r['error_mean']:9.2f} {r['points_per_s']:11,.0f} {r['prepare_s']:10.3f}"
        )


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("data_dir", type=Path)
    parser.add_argument(
        "--methods",
        nargs="+",
        choices=list(METHODS),
        default=list(METHODS),
        metavar="NAME",
        help=f"which to run, of {', '.join(METHODS)}; default: all",
    )
    parser.add_argument("--out", type=Path, metavar="DIR")
    parser.add_argument("--leuven", type=int, metavar="N", help="LeuvenMapMatching on N tracks of each part")
    parser.add_argument("--hour", action="store_true", help="add an hour of simulated driving at 10 Hz")
    parser.add_argument("--skip-leuven", action="store_true")
    args = parser.parse_args()
    rows = run(args)
    summary = summarise(rows)
    show(summary)
    write_json(args.json, {"summary": summary, "tracks": rows})


if __name__ == "__main__":
    main()
