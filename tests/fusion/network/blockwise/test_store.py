"""What work leaves for later work is what it was."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from fusion.network.blockwise import store as of_store
from fusion.network.blockwise.store import FolderStore, MemoryStore, Store


def test_stores_give_what_they_were_given_last(tmp_path: Path) -> None:
    stores: list[Store] = [MemoryStore(), FolderStore(tmp_path)]
    for store in stores:
        for value in (np.arange(3.0), np.linspace(0, 1, 5)):
            store.put(("told", 1), value)
            store.put(("told", 2), -value)
            assert store.get(("told", 1)).tobytes() == value.tobytes()
            assert store.get(("told", 2)).tobytes() == (-value).tobytes()


def test_what_a_folder_gives_may_be_changed(tmp_path: Path) -> None:
    store = FolderStore(tmp_path)
    store.put(("factor", 0), np.zeros(3))
    store.get(("factor", 0))[:] = 1
    assert store.get(("factor", 0)).tolist() == [0, 0, 0]


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
    monkeypatch.setattr(of_store, "_TRIES", 2)
    with pytest.raises(KeyError, match="told"):
        FolderStore(tmp_path).get(("told", 1))
