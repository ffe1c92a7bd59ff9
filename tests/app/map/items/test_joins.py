"""The guide to joins does what it says: its very lines are run."""

from __future__ import annotations

import re
from typing import Any

import pandas
import psycopg
import pytest
import requests

from app.map.derived import following
from clients.joined import BUFFER, GUIDE, fill, judged, queries
from fusion.simulate.scene.town import make_town
from web_fixtures import add_drive

LOCAL_CRS = 25832


def snippets() -> list[str]:
    return re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.fixture
def names(filled: Any, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """What the guide's lines know, read from a service of these tests by pages of 25."""
    for rows, slope in (([0, 1, 2], 3.0), ([10, 11], -2.0), (list(range(20, 50)), 1.0)):
        add_drive(filled.sessions, rows, slope)
    following.follow_all(filled.sessions)
    genuine = requests.get

    def get(address: str, **how: Any) -> requests.Response:
        first = address.replace("http://127.0.0.1:8000", filled.base).replace("limit=10000", "limit=25")
        return genuine(first, **how)

    monkeypatch.setattr(requests, "get", get)
    features = filled.client.get("/collections/segments/items?limit=1000&driven=true").json()["features"]
    driven = [feature["properties"] for feature in features]
    turned = [
        {"osm_way_id": p["osm_way_id"], "from_node": p["to_node"], "to_node": p["from_node"]} for p in driven
    ]
    edges = [{name: p[name] for name in turned[0]} for p in driven]
    return {
        "driven": driven,
        "edges": pandas.DataFrame([*edges, *turned, {**edges[0], "osm_way_id": 10**9}]),
        "counts": pandas.DataFrame({"osm_way_id": [p["osm_way_id"] for p in driven] * 2})
        .drop_duplicates()
        .merge(pandas.DataFrame({"direction": ["forward", "backward"]}), how="cross"),
    }


def test_by_node_and_by_way(names: dict[str, Any]) -> None:
    table, by_node, by_way = snippets()
    exec(table, names)  # noqa: S102 - our own guide
    exec(by_node, names)  # noqa: S102
    expected = [p["slope_percent"] for p in names["driven"]]
    found = names["edges"].slope_percent.tolist()
    assert found[: len(expected)] == pytest.approx(expected)
    assert found[len(expected) : -1] == pytest.approx([-slope for slope in expected])
    assert pandas.isna(found[-1])
    exec(by_way, names)  # noqa: S102
    counts = names["counts"]
    known = counts[counts.slope_percent.notna()]
    assert len(known) > 0
    for _, (forward, backward) in known.groupby("osm_way_id").slope_percent.apply(list).items():
        assert forward == pytest.approx(-backward)
        assert forward != 0


def test_by_geometry(database_url: str) -> None:
    town = make_town(seed=3)
    join, slopes = queries()
    with psycopg.connect(database_url.replace("+psycopg", ""), autocommit=True) as connection:
        fill(connection, town.roads, LOCAL_CRS, cut=True)
        plain = judged(connection, BUFFER, len(town.roads))
        own = judged(connection, join, len(town.roads))
        assert plain["pairs_right"] < 60
        assert own["pairs_right"] > 90
        assert own["segments_right"] > 90
        assert own["directions_right"] > 99
        connection.execute("ALTER TABLE segments ADD slope_percent float8")
        connection.execute("UPDATE segments SET slope_percent = 5")
        turned = connection.execute(
            f"SELECT l.turned, s.slope_percent FROM lines AS l JOIN ({slopes}) AS s ON s.line_id = l.id"
        ).fetchall()
    right = [slope == pytest.approx(-5 if flag else 5) for flag, slope in turned]
    assert sum(right) > 0.9 * len(right) > 50
