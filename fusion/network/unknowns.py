"""Which unknown of the network's equations is what: nodes' heights, segments' knots, and what drives carry along."""

from __future__ import annotations

import numpy as np

from fusion.arrays import counted
from fusion.network.curve import interval_count, knot_length
from fusion.network.pass_columns import PassColumns
from fusion.network.pass_factor import CONSTANTS, ENTRY, LAG, SETTINGS
from fusion.roads.table import RoadTable
from fusion.types import Bools, Floats, Ints


class RoadUnknowns:
    """A height at each node first, then the knot variables of each of the n segments.

    Columns of shape (n,): ``length_m`` is what the knots assume, ``intervals`` how many they span; ``structure``: a
    bridge or tunnel; ``start_node`` and ``end_node`` are the unknowns at the segment's nodes, ``first`` is its first
    own one and ``count`` how many it has. ``nodes`` and ``size`` are the numbers of nodes and of all unknowns.
    """

    def __init__(self, network: RoadTable) -> None:
        self.length_m = knot_length(network.length_m)
        self.structure = network.bridge | network.tunnel
        self.intervals = interval_count(self.length_m)
        ends = np.concatenate([network.from_node, network.to_node])
        _, node = np.unique(ends, return_inverse=True)
        self.start_node, self.end_node = node[: len(network)], node[len(network) :]
        self.nodes = int(node.max()) + 1
        self.count = 2 * (self.intervals + 1)
        self.first = self.nodes + np.concatenate([[0], np.cumsum(self.count)[:-1]])
        self.size = self.nodes + int(self.count.sum())

    def by_intervals(self) -> list[Ints]:
        """Rows of segments with equal numbers of intervals, one array for each number that occurs."""
        return [np.flatnonzero(self.intervals == n) for n in np.unique(self.intervals)]

    def variables(self, rows: Ints) -> Ints:
        """Unknowns (m, 2 * intervals + 2) of segments with equal numbers of intervals, in the order of the knots."""
        return np.asarray(self.first[rows][:, None] + np.arange(int(self.count[rows[0]])))

    def end(self, rows: Ints, at_end: Bools) -> Ints:
        """The unknown that is the height at the start or the end of each row; its grade is the next."""
        return np.where(at_end, self.first[rows] + self.count[rows] - 2, self.first[rows])


class DriveUnknowns:
    """The unknowns of one drive behind ``begin``: constants that its passes speak of, and height errors pass by pass.

    ``of_pass`` has shape (passes, ``NUISANCES``), -1 where a pass does not speak of the unknown. ``keys`` are the
    unknowns of constants by (number in ``CONSTANTS``, setting: ``SETTINGS``), ``constants`` maps them to that number.
    """

    def __init__(self, passes: PassColumns, begin: int) -> None:
        self.begin = begin
        used = passes.used
        setting_of = {"mount": passes.mount, "place": passes.place}
        new, first_of = used.copy(), {}
        for kind in range(len(CONSTANTS)):
            speak = np.flatnonzero(used[:, kind])
            setting = (
                setting_of[SETTINGS[kind]][speak] if kind in SETTINGS else np.zeros(len(speak), np.int64)
            )
            _, first, which = np.unique(setting, return_index=True, return_inverse=True)
            new[:, kind] = False
            new[speak[first], kind] = True
            first_of[kind] = (speak, speak[first][which])
        number = begin + np.cumsum(new).reshape(new.shape) - 1
        self.of_pass = np.where(new, number, -1)
        for kind, (speak, first) in first_of.items():
            self.of_pass[speak, kind] = number[first, kind]
        self.keys = {
            (kind, int(setting_of[SETTINGS[kind]][k]) if kind in SETTINGS else 0): int(number[k, kind])
            for k, kind in np.argwhere(new[:, : len(CONSTANTS)]).tolist()
        }
        self.constants = {unknown: kind for (kind, _), unknown in self.keys.items()}
        self.end = begin + int(np.count_nonzero(new))

    @property
    def lag(self) -> int | None:
        """The unknown that is the altimeter's lag, if any pass speaks of it."""
        return next((unknown for unknown, kind in self.constants.items() if kind == LAG), None)

    def joints(self, sensor: int) -> tuple[Ints, Ints]:
        """Passes k and j, neighbours in the order of driving, that both know the error of a height sensor."""
        known = np.flatnonzero(self.of_pass[:, ENTRY.start + sensor] >= 0)
        return known[:-1], known[1:]


def knot_positions(network: RoadTable) -> tuple[Floats, Floats]:
    """Longitude and latitude of the knots of all segments, one segment after another, degrees."""
    intervals = interval_count(knot_length(network.length_m))
    row, knot = counted(intervals + 1)
    share = knot / intervals[row]
    lon = network.lon0_deg[row] + share * (network.lon1_deg - network.lon0_deg)[row]
    lat = network.lat0_deg[row] + share * (network.lat1_deg - network.lat0_deg)[row]
    return lon, lat


def knot_rows(network: RoadTable) -> Ints:
    """The segment of each of ``knot_positions``: its row."""
    return np.repeat(np.arange(len(network)), interval_count(knot_length(network.length_m)) + 1)
