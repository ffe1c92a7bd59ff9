"""What is served as pages: by which policy, and no other file."""

from __future__ import annotations

import uuid

import pytest

from web_fixtures import Web

PAGES = ("map", "upload", "drives", "admin", "docs", "phones", "record")


def test_policy_allows_this_host_alone(web: Web) -> None:
    for name in (*PAGES, f"drives/{uuid.uuid4()}"):
        answer = web.client.get(f"/{name}")
        policy = answer.headers["Content-Security-Policy"]
        assert answer.status_code == 200
        assert "unsafe" not in policy
        assert "http" not in policy


@pytest.mark.parametrize("name", ["nothing.js", "../pages.py", "%2e%2e/pages.py", "map.html", "assets"])
def test_no_other_file_is_served(web: Web, name: str) -> None:
    assert web.client.get(f"/web/{name}").status_code == 404
