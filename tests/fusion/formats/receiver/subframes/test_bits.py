"""Fields of bits: numbers by hand, written and read back, and messages put together from their parts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fusion.formats.base import Notes
from fusion.formats.receiver.subframes import beidou, glonass, inav, lnav
from fusion.formats.receiver.subframes.bits import (
    MIXED,
    Layout,
    bits_of,
    complete_sets,
    count,
    magnitude,
    nearest,
    numbers,
    read,
    signed,
    user_range_accuracy_m,
    words_of,
    write,
)

LAYOUTS: dict[str, tuple[Layout, int]] = {
    **{f"LNAV {k}": ({**lnav.HEAD, **part}, lnav.BITS) for k, part in lnav.PARTS.items()},
    "LNAV 4": ({**lnav.HEAD, **lnav.IONOSPHERE}, lnav.BITS),
    **{f"I/NAV {k}": ({"kind": inav.KIND, **part}, inav.WORD_BITS) for k, part in inav.PARTS.items()},
    **{f"D1 {k}": ({**beidou.HEAD, **part}, beidou.BITS) for k, part in beidou.D1.items()},
    "D2": (beidou.D2, 10 * beidou.BITS),
    **{
        f"GLONASS {k}": ({"string": glonass.STRING, "frame": glonass.FRAME, **part}, glonass.BITS)
        for k, part in glonass.PARTS.items()
    },
}


def test_words_and_bits() -> None:
    words = np.array([[0x80000001, 0x3FFFFFFF]], np.uint32)
    assert bits_of(words)[0].tolist() == [1, *[0] * 30, 1, 0, 0, *[1] * 30]
    assert bits_of(words, 30)[0].tolist() == [*[0] * 29, 1, *[1] * 30]
    none = np.empty((0, 10), np.uint32)
    assert bits_of(none, 30).shape == (0, 300) and words_of(bits_of(none, 30), 30).shape == (0, 10)
    assert words_of(bits_of(words)).tolist() == words.tolist()
    assert words_of(bits_of(words, 30), 30).tolist() == [[1, 0x3FFFFFFF]]


def test_numbers_by_hand() -> None:
    bits = np.array([[1, 0, 1, 1, 0, 1]], np.uint8)
    assert numbers(bits, count((1, 6))).tolist() == [0b101101]
    assert numbers(bits, signed((1, 6))).tolist() == [0b101101 - 64]
    assert numbers(bits, magnitude((1, 6))).tolist() == [-0b01101]
    assert numbers(bits, count((5, 2), (1, 3))).tolist() == [0b01101]
    assert read(bits, {"x": signed((3, 2), scale=0.5)})["x"].tolist() == [-0.5]


@pytest.mark.parametrize("name", LAYOUTS)
@given(data=st.data())
def test_what_is_read_is_written_back_to_the_last_bit(name: str, data: st.DataObject) -> None:
    layout, size = LAYOUTS[name]
    bits = data.draw(arrays(np.uint8, (2, size), elements=st.integers(0, 1)))
    values = read(bits, layout)
    back = np.zeros_like(bits)
    write(back, layout, values)
    for field_name, field in layout.items():
        assert numbers(back, field).tolist() == numbers(bits, field).tolist(), field_name
        if field.signed != "magnitude":  # which has two zeros
            assert np.array_equal(back[:, field.columns], bits[:, field.columns]), field_name


@pytest.mark.parametrize("name", LAYOUTS)
def test_no_two_fields_share_a_bit(name: str) -> None:
    layout, size = LAYOUTS[name]
    columns = [column for field in layout.values() for column in field.columns]
    assert len(set(columns)) == len(columns) and max(columns) < size


@pytest.mark.parametrize(
    ("field", "wrong"), [(count((1, 4)), 16), (signed((1, 4)), -9), (magnitude((1, 4)), -8)]
)
def test_what_does_not_fit_is_refused(field: object, wrong: float) -> None:
    with pytest.raises(ValueError, match="x does not fit its 4 bits"):
        write(np.zeros((1, 4), np.uint8), {"x": field}, {"x": np.array([wrong])})  # type: ignore[dict-item]


def test_nearest_time_of_a_period() -> None:
    assert nearest(np.array([10.0, 95.0, 105.0]), np.array([98.0, 2.0, 98.0]), 100.0).tolist() == [
        -2,
        102,
        98,
    ]


def sets(
    *messages: tuple[int, int, int, float], parts: tuple[int, ...] = (1, 2, 3)
) -> tuple[list[list[int]], Notes]:
    notes = Notes()
    number, part, issue, time_s = (np.array(c) for c in zip(*messages, strict=True))
    return complete_sets(number, part, issue, time_s.astype(float), parts, 60.0, notes).tolist(), notes


def test_parts_in_any_order_make_a_whole_once() -> None:
    found, notes = sets((7, 3, 5, 0), (7, 1, 5, 6), (8, 2, 5, 6), (7, 2, 5, 12), (7, 1, 5, 30), (7, 2, 5, 36))
    assert found == [[1, 3, 0]]
    assert notes.skipped[MIXED] == 1  # satellite 8


@pytest.mark.parametrize(
    "third", [(7, 3, 6, 12.0), (8, 3, 5, 12.0), (7, 3, 5, 100.0)], ids=["issue", "satellite", "time"]
)
def test_parts_that_do_not_belong_together_make_none(third: tuple[int, int, int, float]) -> None:
    found, notes = sets((7, 1, 5, 0), (7, 2, 5, 6), third)
    assert found == [] and notes.skipped[MIXED] == len({7, third[0]})


def test_a_new_issue_takes_over_when_it_is_whole() -> None:
    found, _ = sets(
        (7, 1, 5, 0), (7, 2, 5, 6), (7, 3, 5, 12), (7, 1, 6, 30), (7, 2, 6, 36), (7, 3, 5, 42), (7, 3, 6, 48)
    )
    assert found == [[0, 1, 2], [3, 4, 6]]


def test_a_part_without_issue_goes_with_any() -> None:
    assert sets((7, 1, 5, 0), (7, 2, -1, 6), parts=(1, 2))[0] == [[0, 1]]


def test_accuracies_by_index() -> None:
    metres = user_range_accuracy_m(np.array([0, 1, 2, 6, 7, 14, 15]))
    assert metres == pytest.approx([2, 2.828, 4, 16, 32, 4096, np.nan], abs=1e-3, nan_ok=True)
