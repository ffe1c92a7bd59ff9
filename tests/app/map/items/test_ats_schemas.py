"""OGC API Features, part 5 (draft): the abstract tests of schemas under their names; and what GDAL makes of them."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from defusedxml import ElementTree
from jsonschema import Draft202012Validator

from app.map.items.collections import COLLECTIONS

SCHEMA = "http://www.opengis.net/def/rel/ogc/1.0/schema"
TEMPORAL = {"primary-instant", "primary-interval-start", "primary-interval-end", "primary-interval"}
KEYWORDS = {
    "$schema",
    "$id",
    "type",
    "title",
    "description",
    "properties",
    "additionalProperties",
    "required",
} | {
    "format",
    "enum",
    "readOnly",
}
ENDS = {"percent": "%", "m": "m"}
OGR_TYPES = {
    ("integer", "int64"): "Integer64",
    ("integer", "int32"): "Integer",
    ("number", None): "Real",
    ("string", None): "String",
    ("string", "date-time"): "DateTime",
    ("boolean", None): "Integer(Boolean)",
}
DTYPES = {
    "Integer64": "int64",
    "Integer": "int32",
    "Real": "float64",
    "String": "object",
    "DateTime": "datetime64[ms]",
    "Integer(Boolean)": "bool",
}


@pytest.fixture(scope="module", params=list(COLLECTIONS))
def schema(request: Any, reading: Any) -> Any:
    """The schema of a collection, found by its link."""
    here = f"{reading.base}/collections/{request.param}"
    (link,) = [one for one in reading.client.get(here).json()["links"] if one["rel"] == SCHEMA]
    assert link["href"] == f"{here}/schema"
    answer = reading.client.get(link["href"], headers={"Accept": "application/schema+json"})
    assert answer.headers["content-type"] == "application/schema+json"
    return answer.json()


def test_ats_schemas_basic_schema_inspection(schema: dict[str, Any], reading: Any) -> None:
    Draft202012Validator.check_schema(schema)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert "?" not in schema["$id"]
    assert reading.client.get(schema["$id"], headers={"Accept": "application/schema+json"}).json() == schema
    assert schema["type"] == "object"
    assert schema["required"]
    for name, one in schema["properties"].items():
        assert isinstance(one["type"], str) if name != "geometry" else "type" not in one
    used = {key for part in (schema, *schema["properties"].values()) for key in part}
    assert {key for key in used if not key.startswith("x-ogc-")} <= KEYWORDS


def test_ats_schemas_role_role_id_property_seq_and_unit(schema: dict[str, Any]) -> None:
    properties = schema["properties"]
    assert [(k, one["type"]) for k, one in properties.items() if one.get("x-ogc-role") == "id"] == [
        ("id", "integer")
    ]
    assert [one["x-ogc-propertySeq"] for one in properties.values()] == list(range(1, len(properties) + 1))
    units = {key: one["x-ogc-unit"] for key, one in properties.items() if "x-ogc-unit" in one}
    assert set(units.values()) <= {"%", "m", "1"}, "UCUM"
    assert all(properties[key]["type"] in {"number", "integer"} for key in units)
    measured = [key for key in properties if key.rsplit("_", 1)[-1] in ENDS]
    assert all(units[key] == ENDS[key.rsplit("_", 1)[-1]] for key in measured)


def test_ats_core_roles_features_primary_geometry_and_temporal(schema: dict[str, Any]) -> None:
    roles = {one["x-ogc-role"]: key for key, one in schema["properties"].items() if "x-ogc-role" in one}
    assert roles["primary-geometry"] == "geometry"
    assert [roles[role] for role in TEMPORAL & set(roles)] == ["updated_at"]
    assert schema["properties"]["updated_at"]["format"] == "date-time"


def test_ats_returnables_and_receivables_response(schema: dict[str, Any], reading: Any) -> None:
    """Every item has what is listed, no more, and of the type that is stated; null only where it may be."""
    items = reading.client.get(schema["$id"].replace("/schema", "/items"), params={"limit": 50}).json()
    for feature in items["features"]:
        known = {key: value for key, value in feature["properties"].items() if value is not None}
        assert set(feature["properties"]) == set(schema["properties"]) - {"geometry"}
        Draft202012Validator(schema).validate({**known, "geometry": feature["geometry"]})
    assert items["features"] or "ways" in schema["$id"]


@pytest.mark.parametrize("name", list(COLLECTIONS))
def test_the_xml_schema_says_the_same(reading: Any, name: str) -> None:
    answer = reading.client.get(f"/collections/{name}/schema", headers={"Accept": "application/xml"})
    assert answer.headers["content-type"].startswith("application/xml")
    elements = ElementTree.fromstring(answer.text).iter("{http://www.w3.org/2001/XMLSchema}element")
    found = {one.get("name"): one.get("type") for one in elements}
    schema = reading.client.get(f"/collections/{name}/schema").json()["properties"]
    assert set(found) - {name} == set(schema) - {"id"}
    assert found["osm_way_id"] == "xs:long"


def expected_types(collection: str) -> dict[str, str]:
    """As GDAL calls them. The id it takes from the first items, of 32 bits while these are small; the FID has 64."""
    known = COLLECTIONS[collection].properties.values()
    return {one.name: OGR_TYPES[one.type, one.format] for one in known if one.name != "id"}


# In a process of its own: GDAL keeps Python's lock while it asks, and the server is in this one.
READER = """
import json, sys
import pyogrio
source = sys.argv[1]
told = {}
for name in ("segments", "ways"):
    info = pyogrio.read_info(source, layer=name)
    told[name] = {"types": dict(zip(info["fields"], info["dtypes"])), "crs": info["crs"]}
meta, fids, lines, columns = pyogrio.raw.read(source, layer="segments", return_fids=True)
told["fids"] = fids.tolist()
told["columns"] = {name: [None if v != v else v for v in column.tolist()] for name, column in
                   zip(meta["fields"], columns) if name != "updated_at"}
where = "bridge = 1 AND highway = 'primary'"
told["bridges"] = len(pyogrio.raw.read(source, layer="segments", where=where)[2])
print(json.dumps(told))
"""


def test_pyogrio_sees_types_and_reads_everything(reading: Any, tmp_path: Path) -> None:
    command = [sys.executable, "-c", READER, f"OAPIF:{reading.base}"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path, timeout=60)
    told = json.loads(done.stdout)
    for name in COLLECTIONS:
        types = {key: type_ for key, type_ in told[name]["types"].items() if key != "id"}
        assert types == {key: DTYPES[type_] for key, type_ in expected_types(name).items()}
        assert "CRS84" in told[name]["crs"]
    columns = told["columns"]
    assert told["fids"] == columns["id"]
    assert len(set(told["fids"])) == 115
    assert sorted(slope for slope in columns["slope_percent"] if slope is not None) == [-1, -1, -1, 1, 3, 3]
    primary = zip(columns["bridge"], columns["highway"], strict=True)
    assert told["bridges"] == sum(bridge and highway == "primary" for bridge, highway in primary) > 0


@pytest.mark.skipif(
    shutil.which("ogrinfo") is None, reason="GDAL's programs (gdal-bin) are not on this machine"
)
def test_ogrinfo_sees_types(reading: Any, tmp_path: Path) -> None:
    """Of whatever age: versions before 3.7 spell the link to the schema in another way."""
    command = ["ogrinfo", "-so", f"OAPIF:{reading.base}", "segments"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    types = dict(
        line.rsplit(" (", 1)[0].split(": ") for line in done.stdout.splitlines() if line.endswith(".0)")
    )
    types.pop("id")
    assert types == expected_types("segments")
    assert "Feature Count: 115" in done.stdout
