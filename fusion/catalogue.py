"""All that can be chosen by name for a drive: methods, positionings, laws of pseudorange errors. A line each.

A new one is one file with a class that follows the role's protocol (``Method``, ``Solver``, ``ErrorModel``), and its
line here.
"""

from __future__ import annotations

from fusion.gnss.error_models.base import ERROR_MODELS
from fusion.gnss.error_models.gaussian import GaussianModel
from fusion.gnss.error_models.one_sided import OneSidedModel
from fusion.gnss.positioning import (
    POSITIONINGS,
    SOLVERS,
    AutomaticPositioning,
    ReceiverPositioning,
    SolverPositioning,
)
from fusion.gnss.solvers.ekf import Ekf
from fusion.gnss.solvers.ls import LeastSquares
from fusion.gnss.solvers.one_sided import OneSided
from fusion.methods.base import METHODS
from fusion.profile.method import ProfileMethod
from fusion.published.baselines import DemMethod, RawMethod
from fusion.published.gps_ins.method import GPS_INS_METHODS
from fusion.published.odometer_map.method import OdometerMapMethod
from fusion.published.particle.method import ParticleMethod
from fusion.published.positioning.dpm import DpmModel
from fusion.published.positioning.gmm import GmmModel
from fusion.published.positioning.jms_gmm import JmsGmm
from fusion.published.positioning.particles import ParticleFilter
from fusion.published.positioning.rbpf_dpm import RbpfDpm
from fusion.published.ukf_dem import UkfDemMethod

SOLVERS.add("ls", LeastSquares(weighted=False))
SOLVERS.add("wls", LeastSquares(weighted=True))
SOLVERS.add("ekf", Ekf())
SOLVERS.add("pf", ParticleFilter())
SOLVERS.add("jms-gmm", JmsGmm())
SOLVERS.add("rbpf-dpm", RbpfDpm())
SOLVERS.add("one-sided", OneSided())

_receiver = ReceiverPositioning()
_computed = {name: SolverPositioning(solver) for name, solver in SOLVERS.items()}
POSITIONINGS.add(AutomaticPositioning.name, AutomaticPositioning(_receiver, _computed["one-sided"]))
POSITIONINGS.add(_receiver.name, _receiver)
for _name, _positioning in _computed.items():
    POSITIONINGS.add(_name, _positioning)

for _model in (GaussianModel(), GmmModel(), DpmModel(), OneSidedModel()):
    ERROR_MODELS.add(_model.name, _model)

for _method in (
    ProfileMethod(),
    ParticleMethod(),
    OdometerMapMethod(),
    *GPS_INS_METHODS,
    UkfDemMethod(),
    RawMethod(),
    DemMethod(),
):
    METHODS.add(_method.name, _method)

__all__ = ["ERROR_MODELS", "METHODS", "POSITIONINGS", "SOLVERS"]
