"""Maps as files: what their suffix says, complete or not at all, whatever names stand in them."""

from __future__ import annotations

from pathlib import Path

import defusedxml.ElementTree
import numpy as np
import pytest

from app.map.picture.slope_picture import write_map
from fusion.errors import UnknownNameError
from map_support import street

HEADS = {".png": b"\x89PNG", ".pdf": b"%PDF", ".svg": b"<?xml"}


@pytest.mark.parametrize("suffix", HEADS)
def test_a_file_is_what_its_suffix_says_and_any_name_may_stand_in_it(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"map{suffix.upper()}"
    credit = r"a $\nonsense$ <b> & \x07 日本.tif"
    segments = street(np.array([4.0, 1.0]), np.array([0.3, 0.3]))
    write_map(path, segments, title="x & <y>", credit=credit)
    data = path.read_bytes()
    assert data.startswith(HEADS[suffix])
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    if suffix == ".svg":
        root = defusedxml.ElementTree.fromstring(data)
        kinds = [element.tag.split("}")[1] for element in root.iter()]
        assert kinds.count("path") > 20
        assert "image" not in [k for k in kinds if k == "image"] or kinds.count("image") <= 1, (
            "lines, not pixels"
        )
        assert "x & <y>" in "".join(root.itertext())
    if suffix == ".pdf":
        assert b"/Subtype /Type0" in data or b"/Type /Font" in data, "letters, not pixels"
        assert b"/Image /Width" not in data


def test_an_unknown_suffix_lists_those_there_are(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"'\.jpg'.*\.png, \.pdf, \.svg"):
        write_map(tmp_path / "map.jpg", street(np.array([4.0]), np.array([0.3])), title="x", credit="y")
    assert not list(tmp_path.iterdir())
