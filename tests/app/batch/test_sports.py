"""Logs of other sports are left out of a batch where that is asked for."""

from __future__ import annotations

from pathlib import Path

from app.batch.folder import BatchFolder
from app.batch.listing import list_logs
from app.batch.locating import chunks
from ride_archive import FIRST, csv_ride, fit_ride, zipped


def test_logs_of_another_sport_are_left_out_where_that_is_asked_for(tmp_path: Path) -> None:
    logs, folder = tmp_path / "logs", BatchFolder(tmp_path / "out")
    logs.mkdir()
    files = {"ride.fit": fit_ride(FIRST), "swim.fit": fit_ride(FIRST, 5), "untold.csv": csv_ride(FIRST)}
    for name, data in (files | {"bundle.zip": zipped({"a.csv": csv_ride(FIRST)})}).items():
        (logs / name).write_bytes(data)
    listed = list_logs([str(logs)])

    def reasons(sports: tuple[str, ...] | None) -> dict[str, str]:
        with folder.held():
            (chunk,) = chunks(folder, listed, {}, "1", sports)
            chunk.work()
        return {one.log.file_name: one.reason for one in chunk.found() if one.reason}

    assert reasons(None) == {}
    assert reasons(("cycling",)) == {
        "swim.fit": "It was recorded as swimming, which does not count as driving on roads."
    }
