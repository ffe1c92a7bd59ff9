"""Which of a satellite's signals on the L1 band is taken: the codes of each system in order of preference.

Codes as in RINEX 3.05, tables 4 to 10 (band and attribute); those of version 2 as in 2.11, table A1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.formats.rinex.header import Header
from fusion.signals import BEIDOU, GLONASS, SYSTEMS

L1_HZ = 1_575_420_000.0
B1I_HZ = 1_561_098_000.0
G1_HZ = 1_602_000_000.0
G1_STEP_HZ = 562_500.0
"""Centre of GLONASS channel k: G1 + k x step (ICD 5.1, section 3.3.1.1)."""

# The open code that most receivers track comes first; those that need a guess at an encrypted one last.
_PREFERRED: dict[str, tuple[str, ...]] = {
    "G": ("1C", "1S", "1X", "1L", "1P", "1W", "1Y", "1M"),
    "R": ("1C", "1P"),
    "E": ("1C", "1X", "1B", "1A", "1Z"),
    "C": ("2I", "2X", "2Q", "1I", "1Q", "1P", "1X", "1D"),
    "J": ("1C", "1S", "1X", "1L", "1E", "1B", "1Z"),
    "S": ("1C",),
}
_PREFERRED_2: dict[str, tuple[str, ...]] = {
    "G": ("C1", "P1"),
    "R": ("C1", "P1"),
    "E": ("C1",),
    "C": ("C2", "C1"),
    "J": ("C1",),
    "S": ("C1",),
}
MOST_CODES = 8
MOST_SLOTS = 100
B1_AS_BAND_1 = 3.03
"""Before this version, the attributes I, Q and X of BeiDou's band 1 mean B1I (RINEX 3.03, table 9, note)."""


@dataclass(frozen=True)
class Columns:
    """Where codes stand in the rows: ``index`` (6, MOST_CODES, 3) counts observations from 0, -1 where there is none.

    The three are pseudorange, Doppler and C/N0; ``factor``, alike, is what values are to be divided by.
    """

    index: NDArray[np.int64]
    factor: NDArray[np.float64]


def columns_of(header: Header) -> Columns:
    """Find the candidates of every system among the types of the header."""
    index = np.full((len(SYSTEMS), MOST_CODES, 3), -1, np.int64)
    factor = np.ones(index.shape)
    for system, letter in enumerate(SYSTEMS):
        types = header.types.get(letter, []) if header.version >= 3 else header.types.get(" ", [])
        for place, code in enumerate(_candidates(header.version)[letter]):
            for quantity, name in enumerate(_names(header.version, code)):
                if name in types:
                    index[system, place, quantity] = types.index(name)
                    factor[system, place, quantity] = header.scale_factor.get((letter, name), 1.0)
    return Columns(index, factor)


def _candidates(version: float) -> dict[str, tuple[str, ...]]:
    return _PREFERRED if version >= 3 else _PREFERRED_2


def _names(version: float, code: str) -> tuple[str, str, str]:
    """The names of pseudorange, Doppler and C/N0; Doppler and C/N0 of version 2 go by band alone."""
    return (code, f"D{code[1]}", f"S{code[1]}") if version < 3 else (f"C{code}", f"D{code}", f"S{code}")


def frequencies_hz(
    version: float, system: NDArray[np.int64], number: NDArray[np.int64], place: NDArray[np.int64],
    channel: dict[int, int],
) -> NDArray[np.float64]:  # fmt: skip
    """The carriers (n,) of the candidates at ``place``; NaN for GLONASS satellites without a known channel."""
    slots = np.full(MOST_SLOTS, np.nan)
    for slot, k in channel.items():
        if slot < MOST_SLOTS:
            slots[slot] = G1_HZ + k * G1_STEP_HZ
    out = np.full(len(system), L1_HZ)
    out[system == GLONASS] = slots[number[system == GLONASS]]
    codes = _candidates(version)["C"]
    is_b1i = np.array([_is_b1i(version, code) for code in codes] + [False] * (MOST_CODES - len(codes)))
    out[(system == BEIDOU) & is_b1i[place]] = B1I_HZ
    return out


def _is_b1i(version: float, code: str) -> bool:
    return version < 3 or code[0] == "2" or code in ("1I", "1Q") or (version < B1_AS_BAND_1 and code == "1X")
