"""The command line speaks German in a German locale, and English in any other; what it writes for programs stays."""

from __future__ import annotations

import pytest

from app.cli.console import Console, language, spoken
from app.cli.drives.look import drive_lines
from fusion.errors import EmptyLogError
from fusion.messages import said, say


@pytest.mark.parametrize(
    ("locale", "spoken_there"),
    [
        ({}, "en"),
        ({"LANG": "C"}, "en"),
        ({"LANG": "de_DE.UTF-8"}, "de"),
        ({"LANG": "en_GB.UTF-8", "LC_MESSAGES": "de_AT"}, "de"),
        ({"LANG": "de_DE.UTF-8", "LC_ALL": "C.UTF-8"}, "en"),
        ({"LANG": "de_DE.UTF-8", "LC_ALL": ""}, "de"),
        ({"LANG": "den_CA"}, "en"),
    ],
)
def test_the_language_is_the_locales(
    locale: dict[str, str], spoken_there: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("LC_ALL", "LC_MESSAGES", "LANG"):
        monkeypatch.delenv(name, raising=False)
    for name, value in locale.items():
        monkeypatch.setenv(name, value)
    assert language() == spoken_there


def test_complaints_remarks_and_drives_are_said_in_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("LC_ALL", "de_DE.UTF-8")
    console, error = Console(), EmptyLogError(say("log.no_file"))
    assert console.complain_of("a.gpx", error) == "No file was given. Upload the log of a drive."
    console.warn("a.gpx", [say("drive.few_on_roads", share=0.456), "Nobody's."])
    told = capsys.readouterr().err.splitlines()
    assert (
        told[0]
        == "versant: a.gpx: Es wurde keine Datei angegeben. Laden Sie die Aufzeichnung einer Fahrt hoch."
    )
    assert told[1].startswith("a.gpx: Nur 46% der Positionen liegen auf bekannten Straßen.")
    assert told[2] == "a.gpx: Nobody's."
    assert spoken(say("processing.split")) == "Teilen Sie die Aufzeichnung in kürzere Fahrten."
    assert spoken("comparing") == "Vergleichen"
    reason, where = say("gpx.no_track", kind="no track"), say("place.line", n=3)
    failure = {"kind": "empty-log", "reason": str(reason), "where": str(where)}
    keys = {"said": said(reason), "where_said": said(where)}
    drive = {
        "id": "1",
        "filename": "a.gpx",
        "status": "failed",
        "method": "profile",
        "failure": failure | keys,
    }
    lines = "\n".join(drive_lines(drive))
    assert "Zeile 3" in lines
    assert "Diese GPX-Datei enthält keine Spur." in lines
    monkeypatch.setenv("LC_ALL", "C")
    assert "This GPX file holds no track." in "\n".join(drive_lines(drive))
