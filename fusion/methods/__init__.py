"""The estimators, by name. A new one is one file with a class that follows ``Method``, and one line here."""

from fusion.methods.base import METHODS
from fusion.methods.dem import DemMethod
from fusion.methods.gps_ins import GPS_INS_METHODS
from fusion.methods.odometer_map import OdometerMapMethod
from fusion.methods.particle import ParticleMethod
from fusion.methods.profile import ProfileMethod
from fusion.methods.raw import RawMethod
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

DEFAULT_METHOD = ProfileMethod.name

__all__ = ["DEFAULT_METHOD", "METHODS"]
