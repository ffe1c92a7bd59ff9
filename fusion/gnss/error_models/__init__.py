"""Laws of the errors of pseudoranges, by name. A new one is one file with a class that follows ``ErrorModel``."""

from __future__ import annotations

from fusion.gnss.error_models.base import ErrorModel
from fusion.gnss.error_models.dpm import DpmModel
from fusion.gnss.error_models.gaussian import GaussianModel
from fusion.gnss.error_models.gmm import GmmModel
from fusion.gnss.error_models.one_sided import OneSidedModel
from fusion.registry import Registry

ERROR_MODELS: Registry[ErrorModel] = Registry("error model")
for _model in (GaussianModel(), GmmModel(), DpmModel(), OneSidedModel()):
    ERROR_MODELS.add(_model.name, _model)
