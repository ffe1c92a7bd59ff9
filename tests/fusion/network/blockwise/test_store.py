"""Values that hands leave for each other."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from fusion.network.blockwise import store
from fusion.network.blockwise.store import FolderStore


def test_a_value_that_is_written_again_and_again_is_always_read_whole(tmp_path: Path) -> None:
    """Also while it is away for a moment."""
    folder = FolderStore(tmp_path)

    def write() -> None:
        for number in range(300):
            folder.put(("told", 1), np.full(1000, number))

    folder.put(("told", 1), np.zeros(1000))
    with ThreadPoolExecutor(2) as threads:
        writing = [threads.submit(write) for _ in range(2)]
        read = 0
        while not all(one.done() for one in writing) or not read:
            assert len(set(folder.get(("told", 1)).tolist())) == 1
            read += 1
        for one in writing:
            one.result()
    assert [path.name for path in tmp_path.iterdir()] == ["told-1"]


def test_a_value_that_nobody_left_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "_TRIES", 2)
    with pytest.raises(KeyError, match="told"):
        FolderStore(tmp_path).get(("told", 1))
