"""The estimators, by name. A new one is one file with a class that follows ``Method``, and one line here."""

from fusion.methods.base import METHODS
from fusion.methods.dem import DemMethod
from fusion.methods.particle import ParticleMethod
from fusion.methods.profile import ProfileMethod
from fusion.methods.raw import RawMethod

METHODS.add(ProfileMethod.name, ProfileMethod())
METHODS.add(ParticleMethod.name, ParticleMethod())
METHODS.add(RawMethod.name, RawMethod())
METHODS.add(DemMethod.name, DemMethod())

DEFAULT_METHOD = ProfileMethod.name

__all__ = ["DEFAULT_METHOD", "METHODS"]
