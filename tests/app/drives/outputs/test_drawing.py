"""The process that draws pictures, and the pictures that are kept."""

from __future__ import annotations

import os
import signal
import uuid
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from sqlalchemy import text

from app.core.errors import NotReadyError
from app.core.settings import Settings
from app.drives.outputs.drawing import Drawing
from app.drives.outputs.profile import Profile, build_profile
from problem_support import check
from server_support import Gate, asked_at_once, wait_until
from web_fixtures import add_drive, fill_roads, grid_roads, track_along

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def profile() -> Profile:
    track = track_along(grid_roads(), [0, 1, 2])
    return build_profile(track, track.segment, {0: (2.0, 0.5)})


@pytest.fixture(scope="module")
def drawing() -> Iterator[Drawing]:
    process = Drawing(most_waiting=0)
    yield process
    process.close()


def pid_of(drawing: Drawing) -> int:
    assert drawing._process is not None
    assert drawing._process.pid is not None
    return drawing._process.pid


def test_pictures_are_drawn_in_another_process(drawing: Drawing, profile: Profile) -> None:
    assert drawing.profile(profile, "a title", None).startswith(PNG)
    assert pid_of(drawing) != os.getpid()


@pytest.mark.slow
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_one_that_was_ended_is_started_again(drawing: Drawing, profile: Profile, how: signal.Signals) -> None:
    drawing.profile(profile, "", None)
    former = pid_of(drawing)
    os.kill(former, how)
    assert drawing.profile(profile, "", None).startswith(PNG)
    assert pid_of(drawing) != former


def test_a_fault_while_drawing_ends_no_process(drawing: Drawing, profile: Profile) -> None:
    drawing.profile(profile, "", None)
    former = pid_of(drawing)
    with pytest.raises(RuntimeError, match="could not be drawn"):
        drawing.profile(None, "", None)  # type: ignore[arg-type]
    assert drawing.profile(profile, "", None).startswith(PNG)
    assert pid_of(drawing) == former


@pytest.mark.slow
def test_one_that_stays_silent_is_ended(
    drawing: Drawing, profile: Profile, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawing.profile(profile, "", None)
    former = pid_of(drawing)
    os.kill(former, signal.SIGSTOP)
    with monkeypatch.context() as patch:
        patch.setattr("app.drives.outputs.drawing.LONGEST_S", 0.1)
        with pytest.raises(NotReadyError, match="took more than"):
            drawing.profile(profile, "", None)
    with pytest.raises(ProcessLookupError):
        os.kill(former, 0)
    assert drawing.profile(profile, "", None).startswith(PNG)


# --- over HTTP ----------------------------------------------------------------------------------------------


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The titles of the pictures that are drawn; each is its number and not a PNG."""
    titles: list[str] = []

    def draw(
        _self: Drawing, _profile: Profile, title: str, _said: object, datum: str, language: str
    ) -> bytes:
        assert datum.startswith(("Heights: ", "What the heights"))
        titles.append(title)
        return f"{len(titles)}{'' if language == 'en' else language}".encode()

    monkeypatch.setattr(Drawing, "profile", draw)
    return titles


def address(drive: uuid.UUID) -> str:
    return f"/v1/drives/{drive}/profile?f=png"


def kept(web: Any) -> int:
    with web.sessions() as session:
        return int(session.execute(text("SELECT count(*) FROM drive_pictures")).scalar_one())


def change(web: Any, statement: str) -> None:
    with web.sessions.begin() as session:
        session.execute(text(statement))


def test_a_picture_is_drawn_once_for_each_result(filled: Any, drawn: list[str]) -> None:
    drive = add_drive(filled.sessions, [0, 1])
    answers = [filled.client.get(address(drive)) for _ in range(3)]
    assert [answer.content for answer in answers] == [b"1"] * 3
    assert {answer.headers["content-type"] for answer in answers} == {"image/png"}
    assert len(drawn) == 1
    change(filled, "UPDATE drives SET generation = 2, status = 'queued', finished_at = NULL")
    assert [filled.client.get(address(drive)).content for _ in range(2)] == [b"2", b"3"], "not kept: it waits"
    change(filled, "UPDATE drives SET status = 'done', finished_at = now()")
    assert [filled.client.get(address(drive)).content for _ in range(2)] == [b"4", b"4"]
    german = [filled.client.get(address(drive), headers={"Accept-Language": "de"}) for _ in range(2)]
    assert [answer.content for answer in german] == [b"5de", b"6de"], (
        "one picture of a drive is kept, in English"
    )
    assert german[0].headers["vary"] == "Accept, Accept-Language"
    assert kept(filled) == 1
    change(filled, "DELETE FROM drives")
    assert kept(filled) == 0
    check(filled.client.get(address(drive)), 404)


def test_the_latest_pictures_are_kept(
    settings: Settings, server_maker: Callable[..., Any], drawn: list[str]
) -> None:
    with server_maker(settings.model_copy(update={"pictures_kept": 2})) as web:
        fill_roads(web.sessions)
        drives = [add_drive(web.sessions, [k]) for k in range(4)]
        for drive in drives:
            web.client.get(address(drive))
        assert kept(web) == 2
        for drive in drives[2:]:
            web.client.get(address(drive))
        assert len(drawn) == 4
        web.client.get(address(drives[0]))
        assert len(drawn) == 5


def test_who_asks_for_the_same_picture_meanwhile_gets_it_and_one_more_is_sent_away(
    settings: Settings, server_maker: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    gate = Gate(lambda *_: b"picture")
    monkeypatch.setattr(Drawing, "profile", lambda self, *wanted: gate(*wanted))
    with server_maker(
        settings.model_copy(update={"pictures_waiting": 6})
    ) as web:  # half of them by one client
        fill_roads(web.sessions)
        drive = add_drive(web.sessions, [0])
        with asked_at_once(web, [address(drive)] * 20) as answers:
            try:
                wait_until(lambda: sum(one.done() for one in answers) == 16)
                assert {one.result() for one in answers if one.done()} == {503}
                answer = web.client.get(address(drive))
                for path in ("/readyz", "/v1/drives", f"/v1/drives/{drive}/profile?f=json"):
                    assert web.client.get(path).status_code == 200
            finally:
                gate.open.set()
        assert sorted(one.result() for one in answers) == [200] * 4 + [503] * 16
        assert gate.most == 1
        assert web.client.get(address(drive)).content == b"picture"
    assert check(answer, 503)["type"] == "/problems/busy"
    assert int(answer.headers["retry-after"]) > 0
