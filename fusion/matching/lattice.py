"""What passes between the compiled loops of the matcher, as plain arrays."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.compiled import F
from fusion.matching.chains import ChainGraph
from fusion.types import Floats, Ints


def inlined(function: F) -> F:
    """As ``compiled``, pasted into its callers: handing over dozens of arrays costs more than most bodies."""
    return cast(F, njit(inline="always")(function))


SAME, TURN, ROUTE = 0, 1, 2
"""How a step goes: on along the chain, back along it, over at least one node."""

START, OFF = -1, -2
"""Instead of a predecessor: the drive begins here; the vehicle was off the road."""


class Candidates(NamedTuple):
    """Possible places of m kept samples: those of sample k are ``start[k]`` to ``start[k + 1]``.

    ``edge`` is the directed chain, ``at_m`` the distance from its tail, ``cost`` the negative logarithm of
    the likelihood of the sample there. ``off``, per sample, is the cost of being off the road.
    """

    start: Ints
    edge: Ints
    at_m: Floats
    cost: Floats
    off: Floats


class Costs(NamedTuple):
    """Negative logarithms of probabilities, and the lengths (m) that bound a step; see ``MatchOptions``."""

    beta_m: float
    beta_share: float
    slack_m: float
    back_m: float
    u_turn: float
    bridge_m: float
    beam: float
    fastest_mps: float
    temperature: float


class Steps(NamedTuple):
    """The way from kept sample k - 1 to k: straight ``chord_m``, ``driven_m`` by the speeds (NaN: unknown), time
    ``lapse_s``; ``gap``: not to be followed; ``switch``: cost of being the first or last sample off the road.
    """

    chord_m: Floats
    driven_m: Floats
    lapse_s: Floats
    gap: NDArray[np.bool_]
    switch: Floats


class Lattice(NamedTuple):
    """The outcome per candidate: least ``cost`` of a path to it, its predecessor ``back`` (or START, OFF), the
    ``kind`` and ``length_m`` of the step. Per sample: ``off_cost`` and ``off_back`` of the off-road state.
    """

    cost: Floats
    back: Ints
    kind: Ints
    length_m: Floats
    off_cost: Floats
    off_back: Ints


class Links(NamedTuple):
    """All steps between candidates that were possible; those to sample k are ``start[k]`` to ``start[k + 1]``."""

    start: Ints
    source: Ints
    target: Ints
    cost: Floats


class Posterior(NamedTuple):
    """How probable the best path is, per kept sample k: that the sample lies on the chain of its state
    (``at``); of the step from k - 1, that it touches the chain it leaves (``out``), the chain it reaches
    (``into``), and that it goes from one to the other (``between``).
    """

    at: Floats
    out: Floats
    into: Floats
    between: Floats


class Pieces(NamedTuple):
    """The path as stays on directed chains, p rows: from ``enter_m`` to ``leave_m`` from the chain's tail, on
    connected stretch ``run``, with probability ``confidence``.
    """

    edge: Ints
    enter_m: Floats
    leave_m: Floats
    run: Ints
    confidence: Floats


class Reach(NamedTuple):
    """Working memory of the shortest-path search, per node, and its heap."""

    dist: Floats
    via: Ints
    stamp: Ints
    key: Floats
    node: Ints


class Problem(NamedTuple):
    """What is searched: the network, the candidates, the steps between the samples, and memory to work in."""

    graph: ChainGraph
    cand: Candidates
    steps: Steps
    reach: Reach
    costs: Costs
