"""QGIS without windows, as a program of its own in QGIS's Python: ``python3 qgis_runner.py FOLDER < ORDERS.json``.

FOLDER has the unzipped plug-in. Each order names an algorithm and its parameters; what came of it is printed as JSON.
A parameter ``{"lines": [WKT, ...], "crs": ...}`` is a layer of these; ``draw`` names a picture of what came out.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from qgis import utils
from qgis.core import (
    QgsApplication,
    QgsAuthMethodConfig,
    QgsFeature,
    QgsGeometry,
    QgsMapRendererParallelJob,
    QgsMapSettings,
    QgsProcessingContext,
    QgsProcessingFeedback,
    QgsProcessingOutputLayerDefinition,
    QgsProcessingUtils,
    QgsProject,
    QgsVectorLayer,
)
from qgis.PyQt.QtCore import QDateTime, QEventLoop, QSize, Qt, QVariant
from qgis.PyQt.QtGui import QColor

SHARED = ["/usr/share/qgis/python", "/usr/share/qgis/python/plugins"]


class Feedback(QgsProcessingFeedback):  # type: ignore[misc]
    """Keeps what is said; ``impatient``: a person who cancels at the first word of progress."""

    def __init__(self, impatient: bool = False) -> None:
        super().__init__(False)
        self.impatient = impatient
        self.said: list[str] = []
        self.errors: list[str] = []

    def setProgressText(self, text: str) -> None:  # noqa: N802
        del text
        if self.impatient:
            self.cancel()

    def pushInfo(self, info: str) -> None:  # noqa: N802
        self.said.append(info)

    def reportError(self, error: str, fatalError: bool = False) -> None:  # noqa: N802
        del fatalError
        self.errors.append(error)


def main(folder: str, orders: dict[str, Any]) -> dict[str, Any]:
    QgsApplication.setPrefixPath("/usr", True)
    application = QgsApplication([], True)
    application.initQgis()
    sys.path[:0] = [folder, *SHARED]
    from processing.core.Processing import Processing  # noqa: PLC0415 - QGIS has to be there first

    Processing.initialize()
    utils.plugin_paths = [folder]
    utils.updateAvailablePlugins()
    assert utils.loadPlugin("versant"), "not loaded"
    assert utils.startProcessingPlugin("versant"), "not started"
    logins = {name: stored_login(*login) for name, login in orders.get("logins", {}).items()}
    registry = QgsApplication.processingRegistry()
    offered = manager_reads(orders["repository"])
    runs = [run(registry, logins, **one) for one in orders["runs"]]
    metadata = {
        key: utils.pluginMetadata("versant", key) for key in ("name", "version", "hasProcessingProvider")
    }
    algorithms = [one.id() for one in registry.providerById("versant").algorithms()]
    form = registry.createAlgorithmById("versant:slopes")
    kept = form.parameterDefinition("SERVER").defaultValue()
    utils.unloadPlugin("versant")
    left = registry.providerById("versant") is not None
    of_plugin = {"metadata": metadata, "algorithms": algorithms, "kept_server": kept, "left": left}
    return {"offered": offered, "runs": runs, **of_plugin}


def manager_reads(address: str) -> dict[str, str]:
    """What QGIS's own plug-in manager takes from a list of plug-ins."""
    from pyplugin_installer import installer_data  # noqa: PLC0415 - as above

    known, one = installer_data.repositories, {"url": address, "authcfg": "", "state": 0, "error": ""}
    known.mRepositories["test"] = one | {"Relay": installer_data.Relay("test")}
    known.requestFetching("test")
    while known.fetchingInProgress():
        QgsApplication.processEvents(QEventLoop.WaitForMoreEvents)
    (plugin,) = installer_data.plugins.repoCache["test"]
    return {name: plugin[name] for name in ("id", "name", "version_available", "download_url", "error")}


def stored_login(name: str, password: str) -> str:
    """A login as QGIS keeps it; its identifier."""
    manager = QgsApplication.authManager()
    manager.setMasterPassword("master", True)
    config = QgsAuthMethodConfig("Basic")
    config.setName("versant")
    config.setConfigMap({"username": name, "password": password})
    stored = manager.storeAuthenticationConfig(config)
    assert stored[0] if isinstance(stored, tuple) else stored
    return str(config.id())


def run(
    registry: Any,
    logins: dict[str, str],
    algorithm: str,
    parameters: dict[str, Any],
    draw: str | None = None,
    cancel: bool = False,
) -> dict[str, Any]:
    """One algorithm, as the toolbox runs it."""
    context, feedback = QgsProcessingContext(), Feedback(cancel)
    context.setProject(QgsProject.instance())
    given = {name: _given(value, logins) for name, value in parameters.items()}
    where = given.pop("FILE", "TEMPORARY_OUTPUT")
    given["OUTPUT"] = QgsProcessingOutputLayerDefinition(where, QgsProject.instance())
    one = registry.createAlgorithmById(f"versant:{algorithm}")
    fits, why = one.checkParameterValues(given, context)
    assert fits, why
    results, done = one.run(given, context, feedback)
    answer = {"done": done, "said": feedback.said, "errors": feedback.errors, "results": results}
    if done:
        layer = QgsProcessingUtils.mapLayerFromString(results["OUTPUT"], context)
        for details in context.layersToLoadOnCompletion().values():
            if details.postProcessor() is not None:
                details.postProcessor().postProcessLayer(layer, context, feedback)
        answer["layer"] = told(layer)
        if draw is not None:
            picture(layer, draw)
    return answer


def _given(value: Any, logins: dict[str, str]) -> Any:
    if isinstance(value, dict):
        layer = QgsVectorLayer(f"LineString?crs={value['crs']}", "lines", "memory")
        for wkt in value["lines"]:
            feature = QgsFeature()
            feature.setGeometry(QgsGeometry.fromWkt(wkt))
            layer.dataProvider().addFeature(feature)
        QgsProject.instance().addMapLayer(layer, False)
        return layer
    return logins.get(value, value) if isinstance(value, str) else value


def told(layer: Any) -> dict[str, Any]:
    """What a layer holds, in plain values."""
    names = [field.name() for field in layer.fields()]
    return {
        "types": {field.name(): QVariant.typeToName(field.type()) for field in layer.fields()},
        "rows": [
            {name: _plain(feature[name]) for name in names} | {"wkt": feature.geometry().asWkt(6)}
            for feature in layer.getFeatures()
        ],
        "crs": layer.crs().authid(),
        "renderer": layer.renderer().type() if layer.renderer() else None,
        "rights": layer.metadata().rights(),
    }


def _plain(value: Any) -> Any:
    if isinstance(value, QVariant):
        return None
    return value.toString(Qt.ISODateWithMs) if isinstance(value, QDateTime) else value


def picture(layer: Any, path: str) -> None:
    """Draw the layer as QGIS does."""
    settings = QgsMapSettings()
    settings.setLayers([layer])
    settings.setDestinationCrs(layer.crs())
    settings.setBackgroundColor(QColor("white"))
    settings.setOutputSize(QSize(500, 500))
    extent = layer.extent()
    extent.grow(0.001)  # a street may have no width
    settings.setExtent(extent)
    job = QgsMapRendererParallelJob(settings)
    job.start()
    job.waitForFinished()
    job.renderedImage().save(path)


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], json.load(sys.stdin))))  # noqa: T201
