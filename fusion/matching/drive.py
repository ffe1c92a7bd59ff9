"""Map matching of a whole drive: a hidden Markov model over the road network (Newson & Krumm 2009)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fusion.matching.candidates import find_candidates, thin
from fusion.matching.chains import ChainGraph, build_chains
from fusion.matching.lattice import OFF, START, Candidates, Costs, Lattice, Posterior, Problem, Reach, Steps
from fusion.matching.path import GAP, NO_CONNECTION, NO_ROAD, Break, PathMatch, empty_match
from fusion.matching.places import Stays, lay_pieces, lay_stays, place_samples, trace
from fusion.matching.posterior import posterior
from fusion.matching.routes import bridge, routes
from fusion.matching.viterbi import LONG_STEP_S, viterbi
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints

_MAP_SIGMA_M = 4.0
_SPEED_STEP_S = 3.0


@dataclass(frozen=True, slots=True)
class MatchOptions:
    """Settings of the drive matcher. Costs are negative logarithms of probabilities, without unit.

    ``sigma_m``: noise of a position across the road, where the samples do not say it, m. ``beta_m``: mean
    difference between the length of the path and the straight line between kept samples, m; it grows by
    ``beta_share`` of the length beyond 50 m. ``spacing_m``: distance between kept samples, m. ``radius_m``: how far
    from a road a sample may be, m. ``slack_m``: a step may be this much longer than the straight line, m.
    ``back_m``: a sample may lie this far behind the one before, m. ``u_turn``: cost of turning round.
    ``off_point``: cost of a kept sample off the road, ``off_far`` where no road is as near as that; ``off_switch``
    and ``off_switch_far``: cost of leaving the road at such a sample, and of coming back from one: high where
    a road is near, or the path would jump between carriageways. ``bridge_m``: samples off the road are
    taken for outliers up to this distance, m. ``beam``: candidates so much worse than the best are given up.
    ``gap_s``, ``gap_m``: a longer gap between positions breaks the path, s and m. ``dwell_s``: without a
    kept sample for so long, the vehicle is taken to stand or creep: the spacing then grows by ``dwell_mps``
    (m/s) up to ``widest_m``. ``heading_weight`` and ``heading_cap``: the course costs
    weight * (1 - cos(difference)), softly bounded by the cap, from ``heading_mps`` (m/s) on. ``fastest_mps``:
    no vehicle is faster, m/s. ``temperature``: what the costs are divided by for ``confidence``, as errors
    of neighbouring samples are not independent.
    """

    sigma_m: float = 7.0
    beta_m: float = 3.0
    beta_share: float = 0.05
    spacing_m: float = 14.0
    radius_m: float = 50.0
    slack_m: float = 50.0
    back_m: float = 18.0
    u_turn: float = 15.0
    off_point: float = 9.0
    off_far: float = 3.0
    off_switch: float = 130.0
    off_switch_far: float = 15.0
    bridge_m: float = 200.0
    beam: float = 200.0
    gap_s: float = 180.0
    gap_m: float = 3000.0
    dwell_s: float = 15.0
    dwell_mps: float = 0.5
    widest_m: float = 40.0
    heading_weight: float = 4.0
    heading_cap: float = 3.0
    heading_mps: float = 2.0
    fastest_mps: float = 70.0
    temperature: float = 2.0

    def costs(self) -> Costs:
        """The part that the compiled loops take."""
        return Costs(
            beta_m=self.beta_m,
            beta_share=self.beta_share,
            slack_m=self.slack_m,
            back_m=self.back_m,
            u_turn=self.u_turn,
            bridge_m=self.bridge_m,
            beam=self.beam,
            fastest_mps=self.fastest_mps,
            temperature=self.temperature,
        )


@dataclass(frozen=True, eq=False)
class _Drive:
    """The samples, checked: shape (n,) each, NaN where unknown."""

    time_s: Floats
    x_m: Floats
    y_m: Floats
    heading_rad: Floats
    speed_mps: Floats
    sigma_m: Floats

    @classmethod
    def of(cls, time_s: ArrayLike, *columns: ArrayLike | None) -> _Drive:
        """Raises ``ValueError`` for columns of different lengths and for times that are unknown or fall."""
        time = np.ascontiguousarray(time_s, np.float64)
        filled = [
            np.full(time.shape, np.nan) if c is None else np.ascontiguousarray(c, np.float64) for c in columns
        ]
        if time.ndim != 1 or any(c.shape != time.shape for c in filled):
            raise ValueError(
                f"the columns of a drive must be vectors of one length, not {[c.shape for c in filled]}"
            )
        if not np.isfinite(time).all() or np.any(np.diff(time) < 0):
            raise ValueError("the times of a drive must be known and must not fall")
        return cls(time, *filled)


class DriveMatcher:
    """Matches drives to one network, which is prepared once.

    Hidden Markov model after Newson & Krumm 2009 over samples some metres apart. The states of a sample are the
    nearest places on the chains of segments about it, each in the directions in which it may be driven, and
    being off the road. Likely are places near the sample (and along its course), steps whose length is that of
    the straight line (or what the speeds say), and no turning round. Steps are bounded shortest paths: where
    none is plausible, the path breaks. The answer is the likeliest path (Viterbi); its ``confidence`` is the
    share of the probability of all paths (forward-backward) that go over the same chain at the same time, at
    the samples where that share is greatest, under the costs divided by ``temperature``. On ways that no sample
    saw it is lowered for a length that fits badly.
    """

    def __init__(self, network: RoadNetwork, options: MatchOptions = MatchOptions()) -> None:
        self.network = network
        self.options = options
        self._graph, self._grid = build_chains(network)

    def match(
        self,
        time_s: ArrayLike,
        x_m: ArrayLike,
        y_m: ArrayLike,
        *,
        heading_rad: ArrayLike | None = None,
        speed_mps: ArrayLike | None = None,
        sigma_m: ArrayLike | None = None,
    ) -> PathMatch:
        """The path of a drive of n samples; all arguments have shape (n,).

        ``time_s`` must not fall; positions are in the network's plane and NaN where there is none;
        ``heading_rad`` is the course (from east, anticlockwise), ``speed_mps`` the speed, ``sigma_m`` the
        accuracy of the position, each NaN where unknown.
        Raises ``ValueError`` for columns of different lengths and for times that are unknown or fall.
        """
        o = self.options
        drive = _Drive.of(time_s, x_m, y_m, heading_rad, speed_mps, sigma_m)
        kept = thin(
            drive.time_s,
            drive.x_m,
            drive.y_m,
            drive.speed_mps,
            o.spacing_m,
            o.dwell_s,
            o.dwell_mps,
            o.widest_m,
        )
        if not len(kept) or not len(self.network):
            nowhere = (Break(float(drive.time_s[kept[0]]), NO_ROAD),) if len(kept) else ()
            return empty_match(len(drive.time_s), nowhere)
        x, y = drive.x_m[kept], drive.y_m[kept]
        sigma = self._sigma(drive.sigma_m[kept])
        radius = np.clip(3.0 * sigma, o.radius_m, 3.0 * o.radius_m)
        slow = drive.speed_mps[kept] < o.heading_mps
        heading = np.where(slow, np.nan, drive.heading_rad[kept])
        cand = find_candidates(
            self._graph,
            self._grid,
            x,
            y,
            heading,
            sigma,
            radius,
            o.heading_weight,
            o.heading_cap,
            o.off_point,
            o.off_far,
        )
        steps = self._steps(drive, kept, cand)
        problem = Problem(self._graph, cand, steps, _working_memory(self._graph), o.costs())
        lattice, links, final = viterbi(problem)
        state = trace(lattice, final)
        chance = posterior(cand, steps, links, state, problem.costs)
        joined = bridge(problem, lattice, state, x, y)
        chance = chance._replace(between=_between(problem, lattice, state, joined, chance))
        route_start, route = routes(problem, lattice, state, joined)
        pieces, along, run = lay_pieces(self._graph, cand, lattice, state, joined, route_start, route, chance)
        stays = lay_stays(self._graph, pieces)
        breaks = _breaks(drive.time_s[kept], cand, steps, state, joined)
        return self._result(drive, kept, stays, along, run, breaks)

    def _sigma(self, given: Floats) -> Floats:
        """Noise across the road: the receiver's and the map's."""
        return np.where(np.isfinite(given), np.hypot(given, _MAP_SIGMA_M), self.options.sigma_m)

    def _steps(self, drive: _Drive, kept: Ints, cand: Candidates) -> Steps:
        """Straight and driven distances from each kept sample to the next."""
        o = self.options
        chord, driven, lapse = (np.zeros(len(kept)) for _ in range(3))
        chord[1:] = np.hypot(np.diff(drive.x_m[kept]), np.diff(drive.y_m[kept]))
        lapse[1:] = np.diff(drive.time_s[kept])
        driven[0] = np.nan
        driven[1:] = _driven(drive, kept)
        driven[lapse <= LONG_STEP_S] = np.nan
        gap = (lapse > o.gap_s) | (chord > o.gap_m)
        gap &= ~(chord <= 2 * o.widest_m)
        switch = np.where(cand.off > o.off_far, o.off_switch, o.off_switch_far)
        return Steps(chord, driven, lapse, gap, switch)

    def _result(
        self, drive: _Drive, kept: Ints, stays: Stays, along: Floats, run: Ints, breaks: tuple[Break, ...]
    ) -> PathMatch:
        reach = np.clip(3.0 * self._sigma(drive.sigma_m), self.options.radius_m, 3.0 * self.options.radius_m)
        row, distance, offset = place_samples(
            self._graph, stays, drive.x_m, drive.y_m, kept, along, run, reach, 0.5 * self.options.spacing_m
        )
        enter_time, leave_time = _times(drive.time_s, stays, kept, along, run, row, distance)
        return PathMatch(
            segment=self._graph.segment[stays.rank],
            forward=stays.forward,
            enter_m=stays.enter_m,
            leave_m=stays.leave_m,
            start_m=stays.start_m,
            enter_time_s=enter_time,
            leave_time_s=leave_time,
            run=stays.run,
            confidence=stays.confidence,
            traversal=row,
            distance_m=distance,
            offset_m=offset,
            breaks=breaks,
        )


def match_drive(
    network: RoadNetwork,
    time_s: ArrayLike,
    x_m: ArrayLike,
    y_m: ArrayLike,
    *,
    heading_rad: ArrayLike | None = None,
    speed_mps: ArrayLike | None = None,
    sigma_m: ArrayLike | None = None,
    options: MatchOptions = MatchOptions(),
) -> PathMatch:
    """``DriveMatcher(network, options).match(...)``, for one drive."""
    return DriveMatcher(network, options).match(
        time_s, x_m, y_m, heading_rad=heading_rad, speed_mps=speed_mps, sigma_m=sigma_m
    )


def _working_memory(graph: ChainGraph) -> Reach:
    """Memory for searches in a graph."""
    nodes, most = len(graph.arrivals), len(graph.out_edge) + 2
    return Reach(
        np.empty(nodes),
        np.empty(nodes, np.int64),
        np.full(nodes, -1),
        np.empty(most),
        np.empty(most, np.int64),
    )


def _between(p: Problem, lattice: Lattice, state: Ints, joined: Ints, chance: Posterior) -> Floats:
    """Probability of the way between kept samples, with doubt where no sample saw it, shape (m,).

    Only the shortest way between two places is ever looked at. Over seconds without a position another one may
    have been driven: the more the length differs from the straight line, or from the distance driven by the
    speeds, the nearer the probability comes to a half of what it is.
    """
    before = np.concatenate([[START], state[:-1]])
    length = lattice.length_m[np.maximum(state, 0)] if len(lattice.length_m) else np.zeros(len(state))
    expected = np.fmax(p.steps.chord_m, p.steps.driven_m)
    cost = np.abs(length - expected) / (
        p.costs.beta_m + p.costs.beta_share * np.maximum(expected - 50.0, 0.0)
    )
    doubt = np.where(p.steps.lapse_s > LONG_STEP_S, 0.5 + 0.5 * np.exp(-0.25 * cost), 1.0)
    return np.where((joined >= 0) & (joined != before), 0.5, chance.between * doubt)


def _driven(drive: _Drive, kept: Ints) -> Floats:
    """Distance driven from each kept sample to the next by the speeds, NaN where they have gaps; (m - 1,)."""
    known = np.flatnonzero(np.isfinite(drive.speed_mps))
    if len(known) < 2:
        return np.full(max(len(kept) - 1, 0), np.nan)
    time, speed = drive.time_s[known], drive.speed_mps[known]
    lapse = np.diff(time)
    way = np.concatenate([[0.0], np.cumsum(lapse * (speed[1:] + speed[:-1]) / 2)])
    gaps = np.concatenate([[0], np.cumsum(lapse > _SPEED_STEP_S)])
    at = drive.time_s[kept]
    before = np.clip(np.searchsorted(time, at), 0, len(time) - 1)
    outside = (at < time[0] - 1.0) | (at > time[-1] + 1.0)
    broken = (np.diff(gaps[before]) > 0) | outside[1:] | outside[:-1]
    return np.where(broken, np.nan, np.diff(np.interp(at, time, way)))


def _breaks(time: Floats, cand: Candidates, steps: Steps, state: Ints, joined: Ints) -> tuple[Break, ...]:
    """Why and when the path is interrupted, from the last sample before to the first after."""
    on = np.flatnonzero(state != OFF)
    empty = np.concatenate([[0], np.cumsum(np.diff(cand.start) == 0)])
    gaps = np.concatenate([[0], np.cumsum(steps.gap)])
    ends = np.flatnonzero(joined[on] == START)
    pairs = [(int(on[i - 1]) if i else -1, int(on[i])) for i in ends]
    if not len(on) or on[-1] < len(state) - 1:
        pairs.append((int(on[-1]) if len(on) else -1, len(state)))
    out = []
    for before, after in pairs:
        if after == 0:
            continue
        if before >= 0 and gaps[min(after, len(state) - 1) + 1] > gaps[before + 1]:
            reason = GAP
        else:
            reason = NO_ROAD if empty[after] > empty[before + 1] else NO_CONNECTION
        out.append(Break(float(time[max(before, 0)]), reason))
    return tuple(out)


def _times(
    time: Floats, stays: Stays, kept: Ints, along: Floats, run: Ints, row: Ints, distance: Floats
) -> tuple[Floats, Floats]:
    """Times of entry and exit of each stay, by distance along the path between the samples of its run."""
    span = np.abs(stays.leave_m - stays.enter_m)
    enter, leave = np.empty(len(span)), np.empty(len(span))
    known, of = distance.copy(), np.where(row >= 0, stays.run[row] if len(span) else -1, -1)
    on = run >= 0
    known[kept[on]], of[kept[on]] = along[on], run[on]
    samples = np.flatnonzero(of >= 0)
    borders = np.searchsorted(of[samples], np.arange(int(stays.run[-1]) + 2 if len(span) else 1))
    rows = np.searchsorted(stays.run, np.arange(len(borders)))
    for r in range(len(borders) - 1):
        mine = samples[borders[r] : borders[r + 1]]
        way = np.maximum.accumulate(known[mine])
        here = slice(rows[r], rows[r + 1])
        ends = np.append(stays.start_m[here], stays.start_m[rows[r + 1] - 1] + span[rows[r + 1] - 1])
        # Where the vehicle stands a distance has many times, and rounding must not turn their order round.
        at = np.maximum.accumulate(np.interp(ends, way, time[mine]))
        enter[here], leave[here] = at[:-1], at[1:]
    return enter, leave
