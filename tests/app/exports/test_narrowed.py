"""Exports of what is sure enough, as the map's page asks for them with the filters of its legend."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from web_fixtures import Web


@pytest.mark.parametrize("form", ["csv", "ways-csv"])
def test_only_what_is_sure_and_was_driven_often(
    driven: Web, work: Callable[..., list[str]], form: str
) -> None:
    """The grid has one drive over three segments, sigma 0.5 %."""

    def entries(**narrowed: float) -> int:
        asked = driven.client.post("/v1/exports", json={"format": form, "driven": True, **narrowed}).json()
        assert asked["request"]["least_drives"] == narrowed.get("least_drives", 0)
        work(driven)
        return int(driven.client.get(f"/v1/exports/{asked['id']}").json()["entries"])

    assert entries() == entries(most_sigma_percent=0.6) == entries(least_drives=1) > 0
    assert entries(most_sigma_percent=0.4) == entries(least_drives=2) == 0


def test_tiles_cannot_be_narrowed_so(driven: Web) -> None:
    refused = driven.client.post("/v1/exports", json={"format": "pmtiles", "least_drives": 1})
    assert refused.status_code == 422
    assert "no such filter" in refused.json()["detail"]
