"""The plug-in for QGIS as a zip, and the list of plug-ins that QGIS's manager asks for updates."""

from __future__ import annotations

import io
import zipfile
from configparser import ConfigParser
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from app.core.version import code_version
from app.exports.writing.qgis_style import qml

SOURCES = Path(__file__).resolve().parent / "plugin"
FOLDER = "versant"
"""What QGIS knows the plug-in by: the folder in the zip."""
ZIP, LIST, STYLE = "versant.zip", "plugins.xml", "slopes.qml"
NAME = "Versant"
OLDEST, NEWEST = "3.22", "3.99"
DESCRIPTION = "Slopes of roads from a Versant service: upload drives, load slopes, draw profiles."
ABOUT = (
    "A Processing provider with three algorithms: upload drives, newest slopes of an area, profile along a line. Needs "
    "a running Versant service; the form names it, and a login that QGIS keeps. Slopes are in percent with one "
    "standard deviation, and are drawn as on the service's map. Data: OpenStreetMap contributors, ODbL."
)
TAGS = "slope,grade,incline,elevation,roads,profile,OpenStreetMap"
LICENCE = """Copyright the contributors of Versant

Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except in compliance with the
License. You may obtain a copy of the License at

    http://www.apache.org/licenses/LICENSE-2.0

Unless required by applicable law or agreed to in writing, software distributed under the License is distributed on an
"AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied. See the License for the specific
language governing permissions and limitations under the License.
"""
_MADE = (1980, 1, 1, 0, 0, 0)
"""Of every file in the zip, so that the same plug-in is the same zip."""


def plugin_zip(base: str) -> bytes:
    """The plug-in of the service at ``base``, which it asks first."""
    files = {
        path.name: path.read_bytes() for path in sorted(SOURCES.iterdir()) if path.suffix in (".py", ".svg")
    }
    made = {
        "metadata.txt": _metadata(base),
        "address.txt": f"{base}\n",
        STYLE: qml(),
        "LICENSE": LICENCE,
    }
    files |= {name: text.encode() for name, text in made.items()}
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(f"{FOLDER}/{name}", _MADE), content, zipfile.ZIP_DEFLATED)
    return whole.getvalue()


def plugin_list(base: str) -> bytes:
    """The list that QGIS's plug-in manager reads: this plug-in in this version, and where its zip is."""
    root = Element("plugins")
    plugin = SubElement(root, "pyqgis_plugin", {"name": NAME, "version": code_version()})
    facts = {
        "description": DESCRIPTION,
        "about": ABOUT,
        "version": code_version(),
        "qgis_minimum_version": OLDEST,
        "qgis_maximum_version": NEWEST,
        "homepage": f"{base}/docs",
        "file_name": ZIP,
        "download_url": f"{base}/qgis/{ZIP}",
        "author_name": NAME,
        "tags": TAGS,
        "experimental": "False",
        "deprecated": "False",
        "server": "False",
    }
    for name, text in facts.items():
        SubElement(plugin, name).text = text
    indent(root)
    text = tostring(root, encoding="unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _metadata(base: str) -> str:
    """As QGIS reads it of every plug-in."""
    parser = ConfigParser(interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser["general"] = {
        "name": NAME,
        "qgisMinimumVersion": OLDEST,
        "qgisMaximumVersion": NEWEST,
        "description": DESCRIPTION,
        "about": ABOUT,
        "version": code_version(),
        "author": NAME,
        "email": "versant@localhost",
        "homepage": f"{base}/docs",
        "tracker": f"{base}/docs",
        "repository": f"{base}/qgis/{LIST}",
        "hasProcessingProvider": "yes",
        "tags": TAGS,
        "category": "Analysis",
        "icon": "icon.svg",
        "experimental": "False",
        "deprecated": "False",
        "server": "False",
    }
    text = io.StringIO()
    parser.write(text, space_around_delimiters=False)
    return text.getvalue()
