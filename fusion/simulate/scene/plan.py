"""Drawing streets: nodes on a plane, and runs of segments between them with their tags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from fusion.types import Floats

GROUND, BRIDGE, TUNNEL = 0, 1, 2


class Kind(NamedTuple):
    """What one segment is; consecutive segments of equal kind form a way. ``oneway`` is 1, -1 or 0."""

    highway: str
    structure: int = GROUND
    oneway: int = 0
    junction: str = ""


@dataclass
class Street:
    """A run of nodes along which the road's profile is smooth; ``kinds`` has one entry per segment."""

    name: str | None
    nodes: list[int]
    kinds: list[Kind] = field(default_factory=list)

    @property
    def closed(self) -> bool:
        """Whether the street ends where it begins."""
        return len(self.nodes) > 2 and self.nodes[0] == self.nodes[-1]


@dataclass
class Plan:
    """Nodes (metres on the town's plane) and the streets between them."""

    rng: np.random.Generator
    x_m: list[float] = field(default_factory=list)
    y_m: list[float] = field(default_factory=list)
    streets: list[Street] = field(default_factory=list)
    footways: list[tuple[int, int]] = field(default_factory=list)
    clearances: list[tuple[int, list[int], float]] = field(default_factory=list)
    """(node of a bridge, nodes of the road under it, metres between the two surfaces)."""
    embanked: set[int] = field(default_factory=set)
    """Nodes that may lie several metres off the ground, on a bank or in a cutting."""
    level: set[int] = field(default_factory=set)
    """Nodes that lie on the ground although their road may be banked elsewhere."""
    merges: list[tuple[int, int, int]] = field(default_factory=list)
    """Three nodes in a row across streets that should pass into each other without a kink in height."""

    def node(self, x_m: float, y_m: float) -> int:
        """Add a node and return its index."""
        self.x_m.append(float(x_m))
        self.y_m.append(float(y_m))
        return len(self.x_m) - 1

    def xy(self, node: int) -> Floats:
        """Position of a node, shape (2,), metres."""
        return np.array([self.x_m[node], self.y_m[node]])

    def street(self, name: str | None, nodes: Sequence[int], kinds: Kind | Sequence[Kind]) -> Street:
        """Add a street along existing nodes; one ``kind`` serves all its segments."""
        kind_of_each = [kinds] * (len(nodes) - 1) if isinstance(kinds, Kind) else list(kinds)
        if len(kind_of_each) != len(nodes) - 1:
            raise ValueError(
                f"{name}: {len(nodes)} nodes need {len(nodes) - 1} kinds, not {len(kind_of_each)}"
            )
        street = Street(name, list(nodes), kind_of_each)
        self.streets.append(street)
        return street

    def pieces(self, length_m: float, low_m: float = 34.0, high_m: float = 72.0) -> Floats:
        """Uneven shares 0 < s < 1 that cut a stretch into segments of roughly ``low_m`` to ``high_m``."""
        count = max(1, round(length_m / float(self.rng.uniform(low_m, high_m))))
        count = max(count, int(np.ceil(length_m / 95.0)))
        while count > 1 and length_m / count < 26.0:
            count -= 1
        jitter = self.rng.uniform(-0.12, 0.12, count - 1)
        return (np.arange(1, count) + jitter) / count


_BEND_M = 26.0


def warp(x_m: Floats, y_m: Floats, phase: Floats) -> tuple[Floats, Floats]:
    """Bend the drawing board smoothly (streets become curves); it fades out north of y = 480 m."""
    x, y = np.asarray(x_m, float), np.asarray(y_m, float)
    fade = np.clip((480.0 - y) / 150.0, 0.0, 1.0)
    dx = np.sin(y / 95.0 + phase[0]) * 0.6 + np.sin((x + y) / 160.0 + phase[1]) * 0.5
    dy = np.sin(x / 105.0 + phase[2]) * 0.6 + np.sin((x - y) / 150.0 + phase[3]) * 0.5
    return x + _BEND_M * fade * dx, y + _BEND_M * fade * dy


def ring(plan: Plan, x_m: float, y_m: float, radius_m: float = 30.0, count: int = 8) -> list[int]:
    """Add the nodes of a roundabout, anticlockwise from east; the k-th lies at k / count of a turn."""
    turn = np.arange(count) * 2 * np.pi / count
    return [plan.node(x_m + radius_m * np.cos(a), y_m + radius_m * np.sin(a)) for a in turn]


def bezier(start: Floats, lead: Floats, trail: Floats, end: Floats, shares: Floats) -> Floats:
    """Points, shape (n, 2), of a cubic Bezier curve at the given shares of its parameter."""
    u = np.asarray(shares, float)[:, None]
    return np.asarray(
        (1 - u) ** 3 * start + 3 * u * (1 - u) ** 2 * lead + 3 * u**2 * (1 - u) * trail + u**3 * end
    )
