"""What the algorithms share: address and login of the service, the last ones as defaults, and how results are drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from qgis.core import (
    QgsFeedback,
    QgsProcessingAlgorithm,
    QgsProcessingContext,
    QgsProcessingException,
    QgsProcessingLayerPostProcessorInterface,
    QgsProcessingParameterAuthConfig,
    QgsProcessingParameterString,
    QgsSettings,
)
from qgis.PyQt.QtGui import QIcon

from .client import Service
from .words import either

HERE = Path(__file__).resolve().parent
STYLE = HERE / "slopes.qml"
ADDRESS = HERE / "address.txt"
"""The service that the plug-in came from, which writes it into the zip."""
ICON = HERE / "icon.svg"

SERVER, LOGIN, OUTPUT = "SERVER", "AUTHCFG", "OUTPUT"
_KEPT = {SERVER: "versant/server", LOGIN: "versant/authcfg"}


class VersantAlgorithm(QgsProcessingAlgorithm):
    """An algorithm that asks a service. Subclasses say their ``NAME``, ``TITLE`` and ``HELP`` (English, German)."""

    NAME = ""
    TITLE = ("", "")
    HELP = ("", "")

    def createInstance(self) -> VersantAlgorithm:
        """Another of the same kind."""
        return type(self)()

    def name(self) -> str:
        """Its identifier."""
        return self.NAME

    def displayName(self) -> str:
        """Its name in the toolbox."""
        return either(*self.TITLE)

    def shortHelpString(self) -> str:
        """What stands beside its form."""
        return either(*self.HELP)

    def icon(self) -> QIcon:
        """Its sign in the toolbox."""
        return QIcon(str(ICON))

    def initAlgorithm(self, _configuration: Any = None) -> None:
        """Its form: first the service, as it was used last."""
        kept = QgsSettings()
        first = ADDRESS.read_text(encoding="utf-8").strip() if ADDRESS.exists() else "http://127.0.0.1:8000"
        self.addParameter(
            QgsProcessingParameterString(
                SERVER,
                either("Address of the service", "Adresse des Dienstes"),
                kept.value(_KEPT[SERVER], first, str),
            )
        )
        self.addParameter(
            QgsProcessingParameterAuthConfig(
                LOGIN,
                either(
                    "Login (Basic: any name, the key as password)",
                    "Anmeldung (Basic: beliebiger Name, der Schlüssel als Passwort)",
                ),
                kept.value(_KEPT[LOGIN], "", str) or None,
                True,
            )
        )
        self.add_more()

    def add_more(self) -> None:
        """Add the parameters and outputs after those of the service."""
        raise NotImplementedError

    def service(self, parameters: Any, context: QgsProcessingContext, feedback: QgsFeedback) -> Service:
        """The service that the form names."""
        address = self.parameterAsString(parameters, SERVER, context)
        return Service(address, self.parameterAsString(parameters, LOGIN, context) or "", feedback)

    def keep(self, parameters: Any, context: QgsProcessingContext) -> None:
        """Remember service and login, which worked, for the next form."""
        for name, key in _KEPT.items():
            QgsSettings().setValue(key, self.parameterAsString(parameters, name, context))

    def sink(self, parameters: Any, context: QgsProcessingContext, *shape: Any) -> tuple[Any, str]:
        """Where results go: the sink, and its identifier."""
        sink, destination = self.parameterAsSink(parameters, OUTPUT, context, *shape)
        if sink is None:
            raise QgsProcessingException(self.invalidSinkError(parameters, OUTPUT))
        return sink, destination


class Finish(QgsProcessingLayerPostProcessorInterface):
    """Draws a layer that is loaded by the style, and says in its metadata whose data it is."""

    _all: list[Finish] = []  # noqa: RUF012 - QGIS does not keep them alive

    def __init__(self, credits_: set[str], style: Path | None = None) -> None:
        super().__init__()
        self._credits, self._style = sorted(credits_), style

    def postProcessLayer(self, layer: Any, _context: QgsProcessingContext, _feedback: QgsFeedback) -> None:
        """Called by QGIS in the thread that draws."""
        about = layer.metadata()
        about.setRights(self._credits)
        layer.setMetadata(about)
        if self._style is not None:
            layer.loadNamedStyle(str(self._style))
            layer.triggerRepaint()

    @classmethod
    def of(
        cls, context: QgsProcessingContext, destination: str, credits_: set[str], style: Path | None = None
    ) -> None:
        """Have a result finished so, where it becomes a layer."""
        if context.willLoadLayerOnCompletion(destination):
            one = cls(credits_, style)
            cls._all = [*cls._all[-20:], one]
            context.layerToLoadOnCompletionDetails(destination).setPostProcessor(one)
