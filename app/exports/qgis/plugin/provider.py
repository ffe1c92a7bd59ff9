"""The provider of the algorithms, and the plug-in that adds it to QGIS."""

from __future__ import annotations

from qgis.core import QgsApplication, QgsProcessingProvider
from qgis.PyQt.QtGui import QIcon

from .algorithm import ICON
from .profile import Profile
from .slopes import Slopes
from .upload import Upload


class VersantProvider(QgsProcessingProvider):
    """Versant in the toolbox of Processing."""

    def id(self) -> str:
        """In front of the names of its algorithms."""
        return "versant"

    def name(self) -> str:
        """In the toolbox."""
        return "Versant"

    def icon(self) -> QIcon:
        """In the toolbox."""
        return QIcon(str(ICON))

    def loadAlgorithms(self) -> None:
        """All there are."""
        for kind in (Slopes, Profile, Upload):
            self.addAlgorithm(kind())


class VersantPlugin:
    """What QGIS starts and stops."""

    def __init__(self) -> None:
        self._provider: VersantProvider | None = None

    def initProcessing(self) -> None:
        """Without windows, as ``qgis_process`` calls it."""
        self._provider = VersantProvider()
        QgsApplication.processingRegistry().addProvider(self._provider)

    def initGui(self) -> None:
        """With windows."""
        self.initProcessing()

    def unload(self) -> None:
        """Take the provider away."""
        if self._provider is not None:
            QgsApplication.processingRegistry().removeProvider(self._provider)
            self._provider = None
