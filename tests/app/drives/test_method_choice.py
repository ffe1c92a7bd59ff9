"""What requests choose is checked, and who chooses nothing unusual loads no method."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import pytest
from sqlalchemy import text

from app.core.errors import BadRequestError
from app.drives.method_choice import (
    asked_columns,
    asked_positioning,
    check_options,
    with_columns_kept,
    with_positioning,
)
from fusion.catalogue import METHODS, POSITIONINGS
from fusion.errors import BadOptionsError, UnknownNameError
from processing_support import HEADER

CHECKED = """
import sys
from app.drives.method_choice import check_options
from fusion.errors import UnknownNameError
check_options("profile", {})
try:
    check_options("nonsense", {"particles": 7})
except UnknownNameError:
    print("fusion.methods" in sys.modules)
check_options("particle", {"particles": 7000})
print("fusion.methods" in sys.modules)
"""


@pytest.mark.slow
def test_who_names_no_options_loads_no_method() -> None:
    done = subprocess.run(
        [sys.executable, "-c", CHECKED],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert done.stdout.split() == ["False", "True"]


def test_a_method_that_there_is_not_is_refused_as_by_the_registry() -> None:
    with pytest.raises(UnknownNameError) as refused:
        check_options("nonsense", {})
    with pytest.raises(UnknownNameError) as unknown:
        METHODS["nonsense"]
    assert str(refused.value) == str(unknown.value)


def test_every_method_can_be_used_as_it_is() -> None:
    for name in METHODS:
        check_options(name, {})
        METHODS[name].options_model()


def test_options_are_those_of_the_method() -> None:
    with pytest.raises(BadOptionsError, match="particles"):
        check_options("particle", {"particles": -1})


def test_a_positioning_goes_into_the_options() -> None:
    assert asked_positioning(None, []) == {}
    assert asked_positioning("receiver", ["a:1", "b:x"]) == {
        "gnss": "receiver",
        "gnss_options": {"a": 1, "b": "x"},
    }
    with pytest.raises(UnknownNameError, match="Choose one of: auto, receiver"):
        asked_positioning("compass", [])
    with pytest.raises(BadRequestError, match="name:value"):
        asked_positioning(None, ["particles"])


def test_another_positioning_leaves_the_options_of_the_one_before() -> None:
    had = {"particles": 7, "gnss": "pf", "gnss_options": {"n": 9}}
    assert with_positioning(had, {}) == with_positioning(had, {"gnss": "pf"}) == had
    assert with_positioning(had, {"gnss": "ls"}) == {"particles": 7, "gnss": "ls"}
    assert with_positioning(had, {"gnss_options": {"n": 8}}) == {**had, "gnss_options": {"n": 8}}
    asked = {"gnss_options": {"n": 9}}
    assert with_positioning(asked, {"gnss": "pf"}) == {"gnss": "pf", "gnss_options": {"n": 9}}
    assert had == {"particles": 7, "gnss": "pf", "gnss_options": {"n": 9}}


def test_columns_belong_to_the_file_whatever_the_method() -> None:
    assert asked_columns([]) == {}
    assert asked_columns(["alt_msl_m = Höhe = NN", "time=t"]) == {
        "columns": {"alt_msl_m": "Höhe = NN", "time": "t"}
    }
    with pytest.raises(BadRequestError, match="name=header"):
        asked_columns(["alt_msl_m"])
    with pytest.raises(BadOptionsError, match=r"'alt_msl' .* Did you mean alt_msl_m"):
        asked_columns(["alt_msl=Altitude"])
    with pytest.raises(BadOptionsError, match="is no column of Versant"):
        check_options("raw", {"columns": {"height": "Altitude"}})
    with pytest.raises(BadOptionsError, match="columns"):
        check_options("raw", {"columns": 5})
    had = {"particles": 7, "columns": {"alt_msl_m": "a"}}
    assert with_columns_kept({}, had) == {"columns": {"alt_msl_m": "a"}}
    assert with_columns_kept({"columns": {"time": "t"}}, had) == {"columns": {"time": "t"}}
    assert with_columns_kept({}, {"particles": 7, "heights": "ellipsoid"}) == {"heights": "ellipsoid"}


def test_columns_are_kept_by_uploads_reruns_and_batches(web: Any) -> None:
    asked = {"columns": ["alt_msl_m=Hoehe", "lon_deg=L"], "method": "raw"}
    first = web.client.post("/v1/drives", content=b"time_s;lat_deg;L;Hoehe\n", params=asked)
    assert first.status_code == 202, first.text
    named = {"columns": {"alt_msl_m": "Hoehe", "lon_deg": "L"}}

    def options() -> Any:
        return web.client.get(first.headers["location"]).json()["options"]

    assert options() == named
    for query in ({}, {"method": "dem"}, {"gnss": "receiver"}):
        again = web.client.post(f"{first.headers['location']}/reprocess", params=query)
        assert again.status_code == 202, again.text
        assert options()["columns"] == named["columns"]
    with web.sessions.begin() as session:
        session.execute(text("UPDATE drives SET status = 'failed', failure_kind = 'x', failure_reason = 'x'"))
    answer = web.client.post("/v1/drives/reprocess?which=all&method=raw")
    assert answer.json()["queued"] == 1
    assert options() == named
    wrong = web.client.post("/v1/drives", content=HEADER, params={"columns": "altitude=x"})
    assert wrong.status_code == 422
    assert "Did you mean alt_msl_m" in wrong.json()["detail"]


def test_uploads_and_reruns_choose_how_positions_are_computed(web: Any) -> None:
    def stored(answer: Any) -> dict[str, Any]:
        assert answer.status_code == 202, answer.text
        options: dict[str, Any] = web.client.get(answer.headers["location"]).json()["options"]
        return options

    asked = {"method": "particle", "option": "particles:700", "gnss": "receiver"}
    first = web.client.post("/v1/drives", content=HEADER, params=asked)
    assert stored(first) == {"particles": 700, "gnss": "receiver"}
    again = f"{first.headers['location']}/reprocess"
    assert stored(web.client.post(again)) == {"particles": 700, "gnss": "receiver"}
    assert stored(web.client.post(again, params={"gnss": "auto"})) == {"particles": 700, "gnss": "auto"}
    assert stored(web.client.post(again, json={"gnss": "receiver", "method": "raw"})) == {"gnss": "receiver"}
    for address, known in (("/v1/drives", False), (again, True)):
        for wrong in ({"gnss": "compass"}, {"option": "gnss:compass"}, {"gnss_option": "no_such:1"}):
            answer = web.client.post(
                address, params=wrong, **({} if known else {"content": HEADER + b"other"})
            )
            assert answer.status_code == 422, answer.text
            assert ", ".join(POSITIONINGS) in answer.text or "gnss_option" in wrong
    assert len(web.client.get("/v1/drives").json()["drives"]) == 1
