"""Map matching of a whole drive: a hidden Markov model over the road network (Newson & Krumm 2009).

This file holds the settings and the order of the work. Each part of the work stands in a file of its own beside it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from fusion.matching.candidates import Likelihoods, Seen, find_candidates
from fusion.matching.chains import Reach, build_chains
from fusion.matching.lattice import LONG_STEP_S, Candidates, Costs, Intervals
from fusion.matching.path import NO_ROAD, Break, PathMatch, empty_match
from fusion.matching.posterior import doubt_unseen_ways, posterior
from fusion.matching.routes import breaks_of, bridge, routes, trace
from fusion.matching.samples import DriveSamples, driven_m, thin
from fusion.matching.stays import KeptSamples, Stays, lay_chain_stays, lay_stays, place_samples, stay_times
from fusion.matching.viterbi import Model, viterbi
from fusion.roads.network import RoadNetwork
from fusion.types import Floats, Ints, Progress, no_progress

_MAP_SIGMA_M = 4.0  # the map's own error across the road, beside the accuracy that the receiver states


@dataclass(frozen=True, slots=True)
class MatchOptions:
    """Settings of the drive matcher. Costs are negative logarithms of probabilities, without unit.

    Which samples are kept: they lie ``spacing_m`` (m) apart. A vehicle without a kept sample for ``dwell_s`` (s) is
    taken to stand or creep: the spacing then grows by ``dwell_mps`` (m/s) up to ``widest_m`` (m).

    Where a sample may be: no farther from a road than ``radius_m`` (m). ``sigma_m`` (m) is the noise of a position
    across the road where the sample states none. From ``heading_mps`` (m/s) on the course costs ``heading_weight``
    times (1 - cos(difference)), softly bounded by ``heading_cap``.

    How a step may go: it is at most ``slack_m`` (m) longer than the straight line, no faster than ``fastest_mps``
    (m/s), and ends at most ``back_m`` (m) behind the sample before. ``beta_m`` (m) is the mean difference between its
    length and the straight line; it grows by ``beta_share`` of the length beyond 50 m. Turning round costs
    ``u_turn``. Candidates that are ``beam`` worse than the best one are given up.

    Off the road: a kept sample there costs ``off_point``, or ``off_far`` where no road is as near as that. Leaving
    the road at such a sample costs ``off_switch`` or ``off_switch_far``, and so does coming back from it. The cost is
    high where a road is near: else the path would jump between carriageways. Samples off the road are taken for
    outliers over up to ``bridge_m`` (m).

    An outage between positions that is longer than ``outage_s`` (s) or ``outage_m`` (m) breaks the path. For
    ``confidence`` the costs are divided by ``temperature``, since errors of neighbouring samples are not independent.
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
    outage_s: float = 180.0
    outage_m: float = 3000.0
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
        return Costs(*(getattr(self, name) for name in Costs._fields))


class DriveMatcher:
    """Matches drives to one network, which is prepared once.

    It is a hidden Markov model after Newson & Krumm 2009 over samples some metres apart. The states of a sample are
    the nearest places on the chains of segments around it, in each direction in which they may be driven, and the
    state of being off the road. A place is likely if it is near the sample and along its course. A step is likely if
    it is as long as the straight line, or as the speeds say, and does not turn round. Steps are shortest paths within
    a bound; where no step is plausible, the path breaks.

    The answer is the likeliest path (Viterbi). Its ``confidence`` on a chain comes from all paths (forward-backward,
    with costs divided by ``temperature``): it is the share of their probability that goes over the same chain at the
    same time, at the sample where this share is greatest. On ways that no sample saw, the confidence is lowered where
    the length fits badly.

    Two limits. Over a gap only the shortest way is a candidate, so that a faster, longer one is not found, and speeds
    around the gap are not asked. Errors that positions share for a minute or more count as if they were independent:
    between parallel roads as near as the noise, the confidence is too high.
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
        progress: Progress = no_progress,
    ) -> PathMatch:
        """The path of a drive of n samples; all arguments have shape (n,).

        ``time_s`` must not fall; positions are in the network's plane and NaN where there is none;
        ``heading_rad`` is the course (from east, anticlockwise), ``speed_mps`` the speed, ``sigma_m`` the
        accuracy of the position, each NaN where unknown.
        Raises ``ValueError`` for columns of different lengths and for times that are unknown or fall.
        """
        drive = DriveSamples.of(time_s, x_m, y_m, heading_rad, speed_mps, sigma_m)
        thinned = self._thinned(drive)
        if not len(thinned) or not len(self.network):
            nowhere = (Break(float(drive.time_s[thinned[0]]), NO_ROAD),) if len(thinned) else ()
            return empty_match(len(drive.time_s), nowhere)
        progress("match", 0.1)
        cand = self._candidates(drive, thinned)
        progress("match", 0.3)
        intervals = self._intervals(drive, thinned, cand)
        model = Model(self._graph, cand, intervals, Reach.of(self._graph), self.options.costs())
        lattice, transitions, final = viterbi(model)
        state = trace(lattice, final)
        progress("match", 0.7)
        chance = posterior(cand, intervals, transitions, state, model.costs)
        progress("match", 0.8)
        joined = bridge(model, lattice, state, drive.x_m[thinned], drive.y_m[thinned])
        chance = doubt_unseen_ways(chance, intervals, model.costs, lattice, state, joined)
        route_start, route = routes(model, lattice, state, joined)
        on_chains, count, along, run = lay_chain_stays(
            self._graph, cand, lattice, state, joined, route_start, route, chance
        )
        progress("match", 0.9)
        stays = lay_stays(self._graph, on_chains.first(count))
        breaks = breaks_of(drive.time_s[thinned], cand, intervals, state, joined)
        return self._result(drive, KeptSamples(thinned, along, run), stays, breaks)

    def _thinned(self, drive: DriveSamples) -> Ints:
        """Indices of the samples that are matched; the others are placed on the path afterwards."""
        o = self.options
        return thin(drive, o.spacing_m, o.dwell_s, o.dwell_mps, o.widest_m)

    def _candidates(self, drive: DriveSamples, thinned: Ints) -> Candidates:
        """Where each kept sample may be; at walking pace its course says nothing."""
        o = self.options
        slow = drive.speed_mps[thinned] < o.heading_mps
        seen = Seen(
            drive.x_m[thinned],
            drive.y_m[thinned],
            np.where(slow, np.nan, drive.heading_rad[thinned]),
            self._sigma(drive.sigma_m[thinned]),
            self._reach(drive.sigma_m[thinned]),
        )
        likely = Likelihoods(o.heading_weight, o.heading_cap, o.off_point, o.off_far)
        return find_candidates(self._graph, self._grid, seen, likely)

    def _sigma(self, given: Floats) -> Floats:
        """Noise across the road: the receiver's and the map's."""
        return np.where(np.isfinite(given), np.hypot(given, _MAP_SIGMA_M), self.options.sigma_m)

    def _reach(self, given: Floats) -> Floats:
        """How far from a road a sample may be: three times its noise, within bounds."""
        return np.clip(3.0 * self._sigma(given), self.options.radius_m, 3.0 * self.options.radius_m)

    def _intervals(self, drive: DriveSamples, thinned: Ints, cand: Candidates) -> Intervals:
        """Straight and driven distances from each kept sample to the next."""
        o = self.options
        chord, driven, lapse = (np.zeros(len(thinned)) for _ in range(3))
        chord[1:] = np.hypot(np.diff(drive.x_m[thinned]), np.diff(drive.y_m[thinned]))
        lapse[1:] = np.diff(drive.time_s[thinned])
        driven[0] = np.nan
        driven[1:] = driven_m(drive, thinned)
        driven[lapse <= LONG_STEP_S] = np.nan
        outage = (lapse > o.outage_s) | (chord > o.outage_m)
        outage &= ~(chord <= 2 * o.widest_m)
        switch = np.where(cand.off > o.off_far, o.off_switch, o.off_switch_far)
        return Intervals(chord, driven, lapse, outage, switch)

    def _result(
        self, drive: DriveSamples, kept: KeptSamples, stays: Stays, breaks: tuple[Break, ...]
    ) -> PathMatch:
        row, distance, offset = place_samples(
            self._graph, stays, drive, kept, self._reach(drive.sigma_m), 0.5 * self.options.spacing_m
        )
        enter_time, leave_time = stay_times(drive.time_s, stays, kept, row, distance)
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
