"""The hidden Markov model of a drive as plain arrays, for compiled loops: its states, its steps and their costs.

Says what they are and computes nothing: ``candidates`` finds the states, ``viterbi`` the steps and the best path.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.types import Floats, Ints

SAME, TURN, ROUTE = 0, 1, 2
"""How a step goes: on along the chain, back along it, over at least one node."""

START, OFF = -1, -2
"""Instead of a predecessor: the drive begins here; the vehicle was off the road."""

LONG_STEP_S = 5.0
"""In a step of more seconds another way than the straight one may have been driven: it may be twice as long."""


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


class Intervals(NamedTuple):
    """What lies between kept sample k - 1 and k: straight ``chord_m``, ``driven_m`` by the speeds (NaN: unknown), time
    ``lapse_s``; ``outage``: not to be followed; ``switch``: cost of being the first or last sample off the road.
    """

    chord_m: Floats
    driven_m: Floats
    lapse_s: Floats
    outage: NDArray[np.bool_]
    switch: Floats


class Lattice(NamedTuple):
    """The outcome per candidate: least ``cost`` of a path to it, its predecessor ``back`` (or START, OFF), the
    ``kind`` and ``length_m`` of the step. Per sample: ``off_cost`` and ``off_back`` of the off-road state.
    """

    cost: Floats
    back: Ints
    kind: NDArray[np.int8]
    length_m: Floats
    off_cost: Floats
    off_back: Ints


class Transitions(NamedTuple):
    """All steps between candidates that were possible; those to sample k are ``start[k]`` to ``start[k + 1]``.

    ``kind`` and ``length_m`` as in ``Lattice``.
    """

    start: Ints
    source: Ints
    target: Ints
    cost: Floats
    kind: NDArray[np.int8]
    length_m: Floats
