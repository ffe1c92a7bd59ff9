"""What requests choose is checked, and who chooses nothing unusual loads no method."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import pytest

from app.core.errors import BadRequestError
from app.drives.method_choice import asked_positioning, check_options, with_positioning
from fusion.errors import BadOptionsError, UnknownNameError
from fusion.gnss import POSITIONINGS
from fusion.methods import METHODS

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


def test_uploads_and_reruns_choose_how_positions_are_computed(web: Any) -> None:
    def stored(answer: Any) -> dict[str, Any]:
        assert answer.status_code == 202, answer.text
        options: dict[str, Any] = web.client.get(answer.headers["location"]).json()["options"]
        return options

    asked = {"method": "particle", "option": "particles:700", "gnss": "receiver"}
    first = web.client.post("/v1/drives", content=b"log", params=asked)
    assert stored(first) == {"particles": 700, "gnss": "receiver"}
    again = f"{first.headers['location']}/reprocess"
    assert stored(web.client.post(again)) == {"particles": 700, "gnss": "receiver"}
    assert stored(web.client.post(again, params={"gnss": "auto"})) == {"particles": 700, "gnss": "auto"}
    assert stored(web.client.post(again, json={"gnss": "receiver", "method": "raw"})) == {"gnss": "receiver"}
    for address, known in (("/v1/drives", False), (again, True)):
        for wrong in ({"gnss": "compass"}, {"option": "gnss:compass"}, {"gnss_option": "no_such:1"}):
            answer = web.client.post(address, params=wrong, **({} if known else {"content": b"other"}))
            assert answer.status_code == 422, answer.text
            assert ", ".join(POSITIONINGS) in answer.text or "gnss_option" in wrong
    assert len(web.client.get("/v1/drives").json()["drives"]) == 1
