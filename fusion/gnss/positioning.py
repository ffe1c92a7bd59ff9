"""From a log to positions by name: as logged, by a solver of its raw measurements, or by whichever is better.

What a solver gives is published with floors on its sigmas. Knows no road; heights of roads may be handed in
(``Positioned.with_heights``).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from fusion.errors import BadOptionsError, EmptyLogError, LogError, MissingSensorError
from fusion.frames import geodetic, local_axes
from fusion.gnss.doppler import doppler_velocities
from fusion.gnss.measure import measure
from fusion.gnss.measurements import (
    Aids,
    Measurements,
    Solution,
    Solver,
    SolverOptions,
    aids_of,
    with_heights,
)
from fusion.messages import joined, say
from fusion.options import Named, OptionsModel
from fusion.registry import DEFAULT_POSITIONING, Registry
from fusion.types import Bools, DriveLog, Floats, GnssFix, GnssVelocity, Progress, no_progress

Model = TypeVar("Model", bound=BaseModel)
H_FLOOR_M, V_FLOOR_M = 5.0, 10.0
"""No position from pseudoranges is stated to be better, horizontally (2-D) and vertically: what a filter does not see
is common to satellites and lasts (notes 6)."""
MIN_SOLVED = 4
"""Fewer epochs with a position are no drive."""


@dataclass(frozen=True)
class Positioned:
    """A log whose positions are those of the positioning called ``name``; the rest where a solver made them.

    ``report`` is JSON-serialisable. ``with_heights`` computes the positions again, helped by heights of the road above
    the ellipsoid at the epochs of ``log.fix``, (n,), NaN where there is none; None where that helps nothing.
    """

    log: DriveLog
    name: str
    measured: Measurements | None = None
    solution: Solution | None = None
    report: dict[str, Any] = field(default_factory=dict)
    with_heights: Callable[[Floats], Positioned] | None = None

    @property
    def height_ell_m(self) -> Floats:
        """Heights above the ellipsoid at the epochs of ``log.fix``, the solver's where there is one; (n,)."""
        if self.solution is None:
            return self.log.fix.height_ell_m
        return geodetic(self.solution.position_m[self.solution.solved])[2]

    def solved_epochs(self) -> SolvedEpochs | None:
        """What a solver knows of each epoch of ``log.fix`` beyond the fix; None where no solver made it."""
        if self.solution is None or self.measured is None:
            return None
        solved = self.solution.solved
        turn = np.kron(np.eye(2), np.ones((3, 3))) * np.tile(
            local_axes(self.solution.position_m[solved]), (1, 2, 2)
        )
        first, names, nlos = self.measured.first, self.measured.names, self.solution.nlos
        reflected = [
            {names[self.measured.satellite[row]]: float(nlos[row]) for row in range(first[k], first[k + 1])}
            for k in np.flatnonzero(solved)
        ]
        covariance = turn @ self.solution.covariance[solved] @ turn.transpose(0, 2, 1)
        return SolvedEpochs(covariance, self.solution.predicted[solved], reflected)


class SolvedEpochs(NamedTuple):
    """(n,) epochs: the covariance (n, 6, 6) of position and velocity, each east, north, up; those that rest on the
    motion alone; and the probability of having been reflected by satellite, NaN where the solver says nothing."""

    covariance: Floats
    predicted: Bools
    reflected: list[dict[str, float]]


class Positioning(Named, Protocol):
    """A named way from what a receiver logged to positions."""

    def positions(self, log: DriveLog, options: OptionsModel, progress: Progress) -> Positioned:
        """The log with positions.

        Raises ``MissingSensorError`` where the log lacks what it takes, ``EmptyLogError`` where no position results.
        """
        ...


SOLVERS: Registry[Solver] = Registry("solver")
POSITIONINGS: Registry[Positioning] = Registry("positioning")
"""Both are filled by ``fusion.catalogue``."""


def positioned(
    log: DriveLog,
    name: str = DEFAULT_POSITIONING,
    options: Mapping[str, Any] | None = None,
    progress: Progress = no_progress,
) -> Positioned:
    """The log with positions by the positioning called ``name``.

    Raises ``UnknownNameError``, ``BadOptionsError``, ``MissingSensorError`` or ``EmptyLogError``, each with a sentence
    for the person who supplied the log.
    """
    chosen = POSITIONINGS[name]
    return chosen.positions(log, options_of(chosen, options), progress)


def options_of(positioning: Positioning, options: Mapping[str, Any] | None) -> OptionsModel:
    """Validate options by name; raises ``BadOptionsError``."""
    return validated(positioning.options_model, options, f"positioning {positioning.name!r}")


def validated(model: type[Model], options: Mapping[str, Any] | None, owner: str) -> Model:
    """Options as their model; raises ``BadOptionsError``, which names the ``owner`` and what it takes."""
    try:
        return model(**(options or {}))
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        names = ", ".join(model.model_fields) or "none"
        raise BadOptionsError(
            say("options.unusable", name=name, owner=owner, fault=first["msg"], names=names), where=name
        ) from None


class ReceiverPositioning:
    """Takes the log's own positions."""

    name = "receiver"
    source = "the receiver itself"
    description = "Positions as logged."
    options_model = SolverOptions

    def positions(self, log: DriveLog, options: OptionsModel, progress: Progress) -> Positioned:
        """The log, unchanged; ``EmptyLogError`` for one that has raw data alone."""
        if not len(log.fix) and log.raw is not None:
            raise EmptyLogError(say("gnss.raw_only"))
        return Positioned(log, self.name, report={"positioning": self.name})


class SolverPositioning:
    """Positions by a solver of raw measurements.

    Velocities are the receiver's own where it logged any with a vertical part, else from Doppler epoch by epoch, else
    the solver's along the ground. Heights are the solver's; no slope is made of them alone (``fusion.pipeline``).
    """

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        self.name, self.source, self.description = solver.name, solver.source, solver.description
        self.options_model = solver.options_model

    def positions(self, log: DriveLog, options: OptionsModel, progress: Progress) -> Positioned:
        """Measure, solve, and put the solution in the place of the log's own positions."""
        if log.raw is None or not len(log.raw.signals):
            raise MissingSensorError(
                say("gnss.needs_raw", name=self.name),
                where="gnss",
            )
        measured = measure(log.raw, lambda stage, share: progress("positioning", 0.3 * share))
        return self._solve(log, measured, aids_of(log, measured.time_s), options, progress)

    def _solve(
        self, log: DriveLog, measured: Measurements, aids: Aids, options: OptionsModel, progress: Progress
    ) -> Positioned:
        solution = self.solver.solve(
            measured, aids, options, 0, lambda stage, share: progress("positioning", 0.3 + 0.7 * share)
        )
        solved = solution.solved
        if solved.sum() < MIN_SOLVED:
            raise EmptyLogError(_nothing_solved(measured, int(solved.sum()), self.name))
        computed = _log_of(log, measured, solution)

        def helped(height_m: Floats) -> Positioned:
            everywhere = np.full(len(measured), np.nan)
            everywhere[solved] = height_m
            return self._solve(log, measured, with_heights(aids, everywhere), options, progress)

        again = None if np.isfinite(aids.height_m).any() else helped
        return Positioned(
            computed, self.name, measured, solution, _report(self.name, measured, solution), again
        )


class AutomaticPositioning:
    """The receiver's own positions, or ``one-sided`` where those are worse by their stated accuracy, or are none."""

    name = "auto"
    source = "ours"
    description = (
        "one-sided where a log has raw data and states no better accuracy of its own, else receiver."
    )
    options_model = SolverOptions

    def __init__(self, receiver: Positioning, solver: Positioning) -> None:
        self._receiver, self._solver = receiver, solver

    def positions(self, log: DriveLog, options: OptionsModel, progress: Progress) -> Positioned:
        """See ``Positioning``. Raw data that give nothing are no reason to refuse a log that has positions."""
        own = self._receiver.options_model()
        no_raw = log.raw is None or not len(log.raw.signals)
        if no_raw or (len(log.fix) and _radius(log.fix) <= H_FLOOR_M):  # no solution is stated to be better
            return self._receiver.positions(log, own, progress)
        try:
            computed = self._solver.positions(log, self._solver.options_model(), progress)
        except LogError as error:
            if not len(log.fix):
                raise
            sentence = say("gnss.raw_unused", error=error)
            return self._receiver.positions(replace(log, warnings=(*log.warnings, sentence)), own, progress)
        if len(log.fix) and _radius(log.fix) <= _radius(computed.log.fix):
            return self._receiver.positions(log, own, progress)
        return computed


def _radius(fix: GnssFix) -> float:
    """The usual accuracy that positions are stated to have, m; infinite where none is stated."""
    stated = fix.h_acc_m[np.isfinite(fix.h_acc_m)]
    return float(np.median(stated)) if len(stated) else np.inf


def _log_of(log: DriveLog, measured: Measurements, solution: Solution) -> DriveLog:
    """The log with the solution's positions, and velocities where it has no vertical one of its own."""
    solved = solution.solved
    place, time_s = solution.position_m[solved], measured.time_s[solved]
    lon, lat, height = geodetic(place)
    axes = local_axes(place)
    local = axes @ solution.covariance[solved][:, :3, :3] @ axes.transpose(0, 2, 1)
    velocity = log.velocity
    if not log.velocity.has("vel_d_mps"):
        velocity = _velocities(measured, solution, solved, axes)
    fix = GnssFix.assemble(
        time_s,
        lat_deg=lat,
        lon_deg=lon,
        height_ell_m=height,
        h_acc_m=np.maximum(np.sqrt(local[:, 0, 0] + local[:, 1, 1]), H_FLOOR_M),
        v_acc_m=np.maximum(np.sqrt(local[:, 2, 2]), V_FLOOR_M),
    )
    new_warnings = tuple(sentence for sentence in measured.warnings if sentence not in log.warnings)
    return replace(log, fix=fix, velocity=velocity, geoid="unknown", warnings=(*log.warnings, *new_warnings))


def _velocities(measured: Measurements, solution: Solution, solved: Bools, axes: Floats) -> GnssVelocity:
    """Doppler's where there are any, else the solver's along the ground."""
    doppler = doppler_velocities(measured, solution.position_m)
    if np.isfinite(doppler.velocity_mps[solved]).any():
        local = np.einsum("nij,nj->ni", axes, doppler.velocity_mps[solved])
        spread = np.sqrt(np.trace(doppler.covariance[solved], axis1=1, axis2=2))
    else:
        local = np.einsum("nij,nj->ni", axes, solution.velocity_mps[solved])
        local[:, 2] = np.nan
        own = axes @ solution.covariance[solved][:, 3:, 3:] @ axes.transpose(0, 2, 1)
        spread = np.sqrt(own[:, 0, 0] + own[:, 1, 1])
    return GnssVelocity.assemble(
        measured.time_s[solved],
        vel_n_mps=local[:, 1],
        vel_e_mps=local[:, 0],
        vel_d_mps=-local[:, 2],
        s_acc_mps=spread,
    )


def _report(name: str, measured: Measurements, solution: Solution) -> dict[str, Any]:
    """What a drive's report says of its positioning."""
    solved = solution.solved
    return {
        "positioning": name,
        "epochs": len(measured),
        "solved": int(solved.sum()),
        "predicted": int((solved & solution.predicted).sum()),
        "satellites": float(np.median(np.diff(measured.first))) if len(measured) else 0.0,
        "systems": list(measured.groups),
        "reflected_share": _share(solution.nlos),
        "counts": dict(measured.counts),
        **solution.report,
    }


def _share(nlos: Floats) -> float | None:
    finite = nlos[np.isfinite(nlos)]
    return float(finite.mean()) if len(finite) else None


def _nothing_solved(measured: Measurements, solved: int, name: str) -> str:
    satellites = int(np.median(np.diff(measured.first))) if len(measured) else 0
    why = joined(measured.warnings) or say("gnss.usual_satellites", n=satellites)
    return say("gnss.too_few_positions", solved=solved, name=name, epochs=len(measured), why=why)
