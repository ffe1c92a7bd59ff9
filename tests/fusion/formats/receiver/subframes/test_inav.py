"""Galileo pages: the checksum and the words as pyrtklib reads them; what is no nominal page is left out."""

from __future__ import annotations

import numpy as np
import pyrtklib
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import inav
from fusion.formats.receiver.subframes.bits import MIXED, Pages, bits_of, write
from fusion.signals import GALILEO, WEEK_S
from fusion.simulate.write.ubx_navigation import inav_parts
from raw_support import by_satellite, kepler_from, random_kepler

BEGIN_S = 2250 * WEEK_S + 7200.0


def octets(bits: np.ndarray) -> object:
    """Bits as pyrtklib takes them."""
    packed = np.packbits(bits)
    out = getattr(pyrtklib, "Arr1Dunsigned char")(len(packed))
    for k, octet in enumerate(packed.tolist()):
        out[k] = octet
    return out


@settings(max_examples=50)
@given(arrays(np.uint8, (1, inav.WORD_BITS), elements=st.integers(0, 1)))
def test_the_checksum_is_pyrtklibs(word: np.ndarray) -> None:
    page = inav.pages_of(word)
    covered = np.concatenate([np.zeros(4, np.uint8), page[0, :114], page[0, 128:210]])  # to whole octets
    assert inav.crc_24q(page).tolist() == [pyrtklib.rtk_crc24q(octets(covered), 25)]


def pages(numbers: list[int], seed: int = 1) -> Pages:
    """One frame of each satellite, part by part."""
    records = random_kepler(GALILEO, numbers, seed, BEGIN_S)
    sent = list(inav_parts(records, np.full(len(numbers), BEGIN_S)))
    bits = np.concatenate([bits_of(words) for _, words in sent])
    n = len(bits)
    return Pages(np.tile(numbers, len(sent)), bits, np.full(n, BEGIN_S + 12.0), np.full(n, -7))


def words_by_type(frame: Pages) -> np.ndarray:
    """Words 0 to 6 of the first satellite, one after another; of 0 and 6 the type, and the time, alone."""
    words = np.zeros((7, inav.WORD_BITS), np.uint8)
    mine = frame.bits[frame.number == frame.number[0]]
    words[1:6] = np.column_stack([mine[:, 2:114], mine[:, 130:146]])
    words[6, 3:5] = 1  # word 6, of which nothing is compared
    time = {"valid": inav.count((7, 2)), "week": inav.count((97, 12)), "tow": inav.count((109, 20))}
    first = np.zeros((1, inav.WORD_BITS), np.uint8)
    write(
        first, time, {"valid": np.array([2.0]), "week": np.array([2250.0 - 1024]), "tow": np.array([7208.0])}
    )
    words[0] = first[0]
    return words.ravel()


@pytest.mark.parametrize("seed", range(5))
def test_words_are_pyrtklibs(seed: int) -> None:
    frame = pages([11], seed)
    theirs = pyrtklib.eph_t()
    aside = pyrtklib.Arr1Ddouble(8)
    assert pyrtklib.decode_gal_inav(octets(words_by_type(frame)), theirs, aside, aside) == 1
    theirs.sat = 59 + 11
    told, ours = by_satellite(kepler_from([theirs])), by_satellite(inav.read_inav(frame, Notes()))
    for name in told:
        if name not in ("sent_s", "accuracy_m", "healthy"):
            assert ours[name] == pytest.approx(told[name], rel=1e-12), name


def test_a_flipped_bit_costs_its_satellite() -> None:
    frame, notes = pages([3, 4]), Notes()
    frame.bits[0, 60] ^= 1
    assert inav.read_inav(frame, notes).number.tolist() == [4]
    assert notes.skipped == {inav.WRONG_CRC: 1, MIXED: 1}


def test_alert_pages_and_halves_in_the_wrong_order_are_counted() -> None:
    frame, notes = pages([3]), Notes()
    frame.bits[0, 1] = 1
    frame.bits[1, 0] = 1
    assert len(inav.read_inav(frame, notes)) == 0
    assert notes.skipped[inav.NO_PAGE] == 2


def test_a_word_that_names_another_satellite_is_not_used() -> None:
    frame = pages([3])
    stranger = Pages(np.full(5, 4), frame.bits, frame.near_s, frame.channel)
    assert len(inav.read_inav(stranger, Notes())) == 0


def test_accuracies_by_index() -> None:
    index = np.array([0.0, 49, 50, 74, 75, 99, 100, 125, 126, 255])
    metres = [0, 0.49, 0.5, 0.98, 1.0, 1.96, 2.0, 6.0, np.nan, np.nan]
    assert inav.signal_accuracy_m(index) == pytest.approx(metres, nan_ok=True)
