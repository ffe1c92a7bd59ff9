"""The plug-in for QGIS as the service offers it: what QGIS and its repository of plug-ins demand of a zip."""

from __future__ import annotations

import ast
import io
import re
import zipfile
from configparser import ConfigParser
from pathlib import PurePosixPath
from typing import Any

import pytest
from defusedxml.ElementTree import fromstring

from app.core.version import code_version
from app.exports.qgis.package import SOURCES, plugin_list, plugin_zip
from app.exports.writing.qgis_style import qml

BASE = "https://slopes.example/versant"
OLDEST_PYTHON = (3, 9)
"""Of QGIS 3.22 on Windows."""
DEMANDED = (
    "name qgisMinimumVersion description about version author email repository tracker homepage "
    "hasProcessingProvider"
)


@pytest.fixture(scope="module")
def archive() -> zipfile.ZipFile:
    return zipfile.ZipFile(io.BytesIO(plugin_zip(BASE)))


def test_the_zip_is_what_plugin_repositories_take(archive: zipfile.ZipFile) -> None:
    assert archive.testzip() is None
    names = [PurePosixPath(name) for name in archive.namelist()]
    assert {name.parts[0] for name in names} == {"versant"}
    assert {name.suffix for name in names} <= {".py", ".txt", ".svg", ".qml", ""}
    assert {"__init__.py", "metadata.txt", "LICENSE", "icon.svg", "slopes.qml"} <= {one.name for one in names}
    assert archive.read("versant/slopes.qml").decode() == qml()
    assert b"def classFactory(" in archive.read("versant/__init__.py")
    assert plugin_zip(BASE) == plugin_zip(BASE), "the same version is the same zip"


def test_metadata_says_all_that_is_demanded(archive: zipfile.ZipFile) -> None:
    parser = ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(archive.read("versant/metadata.txt").decode())
    facts = dict(parser["general"])
    assert [name for name in DEMANDED.split() if not facts.get(name)] == []
    assert facts["version"] == code_version()
    assert facts["hasProcessingProvider"] == "yes"
    assert re.fullmatch(r"\d+\.\d+", facts["qgisMinimumVersion"])
    assert facts["homepage"].startswith(BASE)
    assert f"versant/{facts['icon']}" in archive.namelist()


def test_sources_run_in_an_old_python_and_need_nothing_of_ours(archive: zipfile.ZipFile) -> None:
    sources = [name for name in archive.namelist() if name.endswith(".py")]
    assert len(sources) == len([*SOURCES.glob("*.py")])
    for name in sources:
        tree = ast.parse(archive.read(name).decode(), feature_version=OLDEST_PYTHON)
        absolute = {
            (node.module or "") if isinstance(node, ast.ImportFrom) else alias.name
            for node in ast.walk(tree)
            if isinstance(node, ast.Import | ast.ImportFrom) and not getattr(node, "level", 0)
            for alias in node.names
        }
        assert {one.split(".")[0] for one in absolute} & {"app", "fusion", "numpy", "requests"} == set()


def test_the_list_names_this_version_and_where_it_is() -> None:
    (plugin,) = fromstring(plugin_list(BASE))
    assert (plugin.tag, plugin.attrib) == ("pyqgis_plugin", {"name": "Versant", "version": code_version()})
    assert plugin.findtext("download_url") == f"{BASE}/qgis/versant.zip"
    assert plugin.findtext("file_name") == "versant.zip"
    assert plugin.findtext("qgis_minimum_version") == "3.22"


def test_the_service_offers_list_zip_and_style_to_everybody(keyed: Any) -> None:
    client, base = keyed.web.client, keyed.web.base
    listed = client.get("/qgis/plugins.xml")
    assert (listed.status_code, listed.headers["content-type"]) == (200, "application/xml")
    address = fromstring(listed.content)[0].findtext("download_url")
    zipped = client.get(address)
    assert zipped.headers["content-type"] == "application/zip"
    with zipfile.ZipFile(io.BytesIO(zipped.content)) as archive:
        assert archive.read("versant/address.txt").decode() == f"{base}\n"
    again = client.get(address, headers={"If-None-Match": zipped.headers["etag"]})
    assert (again.status_code, again.content) == (304, b"")
    assert client.get("/qgis/slopes.qml").text == qml()
