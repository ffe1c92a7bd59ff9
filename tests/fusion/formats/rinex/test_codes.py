"""Which codes are taken, and on which carriers."""

from __future__ import annotations

import numpy as np
import pytest

from fusion.formats.rinex.header import Header
from fusion.formats.rinex.observations import MOST_CODES, columns_of, frequencies_hz
from fusion.signals import BEIDOU, GALILEO, GLONASS, GPS, SYSTEMS


def columns(version: float, **types: str) -> list[list[int]]:
    """Where pseudorange, Doppler and C/N0 of the first candidate of a system stand, for each system named."""
    header = Header(version, "O", "M", types={k.replace("_", " "): v.split() for k, v in types.items()})
    index = columns_of(header)[0]
    out = []
    for letter in types:
        own = index[SYSTEMS.find(letter) if letter != "_" else GPS]
        there = own[own[:, 0] >= 0]
        out.append(there[0].tolist() if len(there) else [])
    return out


@pytest.mark.parametrize(
    ("types", "wanted"),
    [
        ("C1C L1C D1C S1C", [0, 2, 3]),
        ("C1W D1W C1C", [2, -1, -1]),
        ("C5Q C2W", []),
        ("S1X C1X", [1, -1, 0]),
    ],
)
def test_the_candidate_that_is_preferred_stands_first(types: str, wanted: list[int]) -> None:
    assert columns(3.04, G=types) == [wanted]


def test_version_2_goes_by_band() -> None:
    assert columns(2.11, _="P1 C1 D1 S1") == [[1, 2, 3]]
    assert columns(2.11, _="P1 D1 S1") == [[0, 1, 2]]


def test_no_system_has_more_candidates_than_there_is_room_for() -> None:
    everything = [f"C{band}{a}" for band in range(1, 10) for a in "ABCDEILMPQSWXYZ"]
    for version in (2.11, 3.02, 3.04, 4.0):
        header = Header(version, "O", "M", types=dict.fromkeys([*SYSTEMS, " "], everything))
        assert columns_of(header)[0].shape == (len(SYSTEMS), MOST_CODES, 3)


def test_carriers() -> None:
    system = np.array([GPS, GALILEO, GLONASS, GLONASS, BEIDOU])
    number = np.array([7, 11, 2, 20, 21])
    found = frequencies_hz(3.04, system, number, np.zeros(5, np.int64), {2: -4})
    assert found[[0, 1]].tolist() == [1575.42e6] * 2
    assert found[2] == 1602e6 - 4 * 562.5e3
    assert np.isnan(found[3])
    assert found[4] == 1561.098e6
