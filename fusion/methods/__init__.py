"""The estimators, by name. A new one is one file with a class that follows ``Method``, and one line here."""

from fusion.methods.base import METHODS
from fusion.methods.baselines import DemMethod, RawMethod
from fusion.methods.gps_ins.method import GPS_INS_METHODS
from fusion.methods.odometer_map.method import OdometerMapMethod
from fusion.methods.particle.method import ParticleMethod
from fusion.methods.profile.method import ProfileMethod
from fusion.methods.ukf_dem import UkfDemMethod

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

__all__ = ["METHODS"]
