"""A client generated from the OpenAPI document: it compiles, and it works against the service."""

from __future__ import annotations

import compileall
import importlib
import json
import subprocess
import sys
from http import HTTPStatus
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

CONFIG = """
post_hooks: []
literal_enums: true
content_type_overrides:
  application/vnd.mapbox-vector-tile: application/octet-stream
  application/x-protobuf: application/octet-stream
  application/geo+json: application/json
"""
LOG = b"time_s,lat_deg,lon_deg,alt_msl_m\n1700000000,49.001,8.401,120\n1700000001,49.0011,8.401,120.1\n"


@pytest.fixture
def generated(filled: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Name of the package made from the document that the running service answers with."""
    (tmp_path / "openapi.json").write_text(filled.client.get("/openapi.json").text)
    (tmp_path / "config.yml").write_text(CONFIG)
    command = [
        sys.executable, "-m", "openapi_python_client", "generate", "--path", "openapi.json", "--meta", "none",
        "--output-path", "versant_client", "--config", "config.yml",
    ]  # fmt: skip
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    monkeypatch.syspath_prepend(tmp_path)
    assert compileall.compile_dir(tmp_path / "versant_client", quiet=1)
    return "versant_client"


def operation(package: str, filled: Any, name: str) -> Any:
    """The module of the route with that function's name here."""
    paths = filled.client.get("/openapi.json").json()["paths"]
    (found,) = [
        one for path in paths.values() for one in path.values() if one["operationId"].startswith(f"{name}_")
    ]
    tag = {"map": "map_"}.get(found["tags"][0], found["tags"][0])
    return importlib.import_module(
        f"{package}.api.{tag}.{found['operationId'].strip('_').replace('__', '_')}"
    )


def test_a_generated_client_uploads_a_drive_and_reads_segments(generated: str, filled: Any) -> None:
    types = importlib.import_module(f"{generated}.types")
    package = importlib.import_module(generated)
    with package.Client(base_url=filled.base, raise_on_unexpected_status=True) as client:
        body = types.File(payload=BytesIO(LOG), file_name="drive.csv", mime_type="text/csv")
        sent = operation(generated, filled, "upload_drive").sync_detailed(client=client, body=body)
        assert sent.status_code == HTTPStatus.ACCEPTED
        drive = operation(generated, filled, "get_drive").sync(sent.parsed.id, client=client)
        assert (drive.id, drive.status) == (sent.parsed.id, "queued")
        listed = operation(generated, filled, "list_drives").sync(client=client)
        assert [one.id for one in listed.drives] == [sent.parsed.id]
        page = operation(generated, filled, "items_of_segments").sync_detailed(client=client, limit=50)
        assert page.status_code == HTTPStatus.OK, page.content
        shown = json.loads(page.content)
        assert len(shown["features"]) == 50
        number = shown["features"][0]["id"]
        one = operation(generated, filled, "get_segment").sync_detailed(number, client=client)
        assert json.loads(one.content)["id"] == number
        lost = operation(generated, filled, "get_segment").sync_detailed(999_999_999, client=client)
        assert (lost.status_code, lost.parsed.status) == (HTTPStatus.NOT_FOUND, 404)
    packages = list((Path(package.__file__).parent / "api").rglob("*.py"))
    operations = [one for path in filled.client.get("/openapi.json").json()["paths"].values() for one in path]
    assert len([path for path in packages if path.name != "__init__.py"]) == len(operations)
