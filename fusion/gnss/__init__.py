"""How positions are computed from a log, by name: as logged, or by solvers of its raw pseudoranges.

A new solver is one file with a class that follows ``Solver``, and one line here. Knows no road and no elevation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from fusion.gnss.measurements import Solver
from fusion.gnss.positioning import (
    AutomaticPositioning,
    Positioned,
    Positioning,
    ReceiverPositioning,
    SolverPositioning,
    options_of,
    validated,
)
from fusion.gnss.solvers.ekf import Ekf
from fusion.gnss.solvers.jms_gmm import JmsGmm
from fusion.gnss.solvers.ls import LeastSquares
from fusion.gnss.solvers.one_sided import OneSided
from fusion.gnss.solvers.particles import ParticleFilter
from fusion.gnss.solvers.rbpf_dpm import RbpfDpm
from fusion.registry import DEFAULT_POSITIONING, Registry
from fusion.types import DriveLog, Progress, no_progress

SOLVERS: Registry[Solver] = Registry("solver")
SOLVERS.add("ls", LeastSquares(weighted=False))
SOLVERS.add("wls", LeastSquares(weighted=True))
SOLVERS.add("ekf", Ekf())
SOLVERS.add("pf", ParticleFilter())
SOLVERS.add("jms-gmm", JmsGmm())
SOLVERS.add("rbpf-dpm", RbpfDpm())
SOLVERS.add("one-sided", OneSided())

POSITIONINGS: Registry[Positioning] = Registry("positioning")
_receiver = ReceiverPositioning()
_computed = {name: SolverPositioning(solver) for name, solver in SOLVERS.items()}
POSITIONINGS.add(AutomaticPositioning.name, AutomaticPositioning(_receiver, _computed["one-sided"]))
POSITIONINGS.add(_receiver.name, _receiver)
for _name, _positioning in _computed.items():
    POSITIONINGS.add(_name, _positioning)

__all__ = ["POSITIONINGS", "SOLVERS", "Positioned", "Positioning", "options_of", "positioned", "validated"]


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
