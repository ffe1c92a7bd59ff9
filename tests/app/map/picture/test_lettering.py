"""Text on pictures: lines fit their width, nothing is lost, and nothing that the font lacks is written."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.map.picture.lettering import is_writable, width_pt, wrapped, writable


@given(st.text(max_size=120), st.floats(30, 300))
def test_every_line_fits_and_every_letter_stays(text: str, room_pt: float) -> None:
    lines = wrapped(text, 8.0, room_pt)
    assert lines
    assert all(width_pt(line, 8.0) <= room_pt for line in lines)
    assert "".join(lines).replace(" ", "") == writable(text).replace(" ", "")
    assert all(is_writable(line) for line in lines)


@pytest.mark.parametrize(
    ("text", "shown"), [("日本.csv", "??.csv"), ("a\tb\x07\nc", "a b c"), ("Straße Ж", "Straße Ж")]
)
def test_what_the_font_lacks_is_marked(text: str, shown: str) -> None:
    assert writable(text) == shown
