"""What requests choose is checked, and who chooses nothing unusual loads no method."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from app.drives.method_choice import check_options
from fusion.errors import BadOptionsError, UnknownNameError
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
