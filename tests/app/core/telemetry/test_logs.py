"""Lines of the log: their fields and ids, as text and as JSON, and what never stands in them."""

from __future__ import annotations

import io
import json
import logging
import threading
import warnings
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import uvicorn

from app.core.settings import Settings
from app.core.telemetry.logs import CHATTY, about, begin_logging, blanked, tell

Begin = Callable[..., io.StringIO]
logger = logging.getLogger("app.some.place")


@pytest.fixture
def begin(monkeypatch: pytest.MonkeyPatch) -> Iterator[Begin]:
    """``begin(**settings)``: log as a process does; what it writes."""
    root = logging.getLogger()
    level, handlers = root.level, list(root.handlers)
    chatty = {name: logging.getLogger(name).level for name in (*CHATTY, "uvicorn.error")}
    for name in ("uvicorn", "uvicorn.error"):  # servers of other tests have a log of their own
        monkeypatch.setattr(logging.getLogger(name), "handlers", [])
        monkeypatch.setattr(logging.getLogger(name), "propagate", True)
        logging.getLogger(name).setLevel(logging.NOTSET)

    def start(**settings: Any) -> io.StringIO:
        written = io.StringIO()
        monkeypatch.setattr("sys.stderr", written)
        begin_logging(Settings(**settings), "worker 2")
        return written

    yield start
    logging.captureWarnings(capture=False)
    root.handlers[:] = handlers
    root.setLevel(level)
    for name, former in chatty.items():
        logging.getLogger(name).setLevel(former)


def test_a_line_of_text_names_its_ids_and_figures(begin: Begin) -> None:
    written = begin()
    with about(job=7), about(drive="d1", request=None):
        tell(logger, "drive done", km=6.24031, reason="No road.", stage=None)
    moment, rest = written.getvalue().split(" ", 1)
    assert moment.endswith("Z") and len(moment) == len("2026-11-23T04:00:00.000Z")
    level, process, said = rest.split(" ", 2)[0], rest.split("[")[0], rest.split("]", 1)[1]
    assert (level, process) == ("INFO", "INFO worker 2")
    assert said == ' app.some.place: drive done job=7 drive=d1 km=6.24 reason="No road."\n'


def test_a_line_of_json_has_the_same(begin: Begin) -> None:
    written = begin(log_format="json")
    with about(drive="d1"):
        tell(logger, "drive done", km=6.24031, warnings=2)
        try:
            raise ValueError("odd\nthing")
        except ValueError:
            logger.exception("it failed for %s", "a reason")
    first, second = (json.loads(line) for line in written.getvalue().splitlines())
    assert {name: first[name] for name in ("level", "logger", "event", "drive", "km", "warnings")} == {
        "level": "INFO",
        "logger": "app.some.place",
        "event": "drive done",
        "drive": "d1",
        "km": 6.24,
        "warnings": 2,
    }
    assert second["event"] == "it failed for a reason"
    assert second["drive"] == "d1"
    assert second["error"].endswith("ValueError: odd\nthing")


def test_a_field_never_takes_the_place_of_what_every_line_has(begin: Begin) -> None:
    written = begin(log_format="json")
    tell(logger, "drive done", event_="x", **{"logger": "mine", "time": 3})
    line = json.loads(written.getvalue())
    assert (line["logger"], line["event"]) == ("app.some.place", "drive done")


def test_ids_end_with_their_block_and_stay_in_their_thread(begin: Begin) -> None:
    written = begin()
    with about(drive="d1"):
        other = threading.Thread(target=tell, args=(logger, "elsewhere"))
        other.start()
        other.join()
    tell(logger, "after")
    assert "d1" not in written.getvalue()


def test_messages_of_libraries_are_lines_of_the_same_kind(begin: Begin) -> None:
    written = begin(log_format="json")
    uvicorn.Config("app.main:create_app", log_config=None, access_log=False)  # as the command makes it
    logging.getLogger("uvicorn.error").error("Exception in %s", "ASGI")
    logging.getLogger("uvicorn.error").info("Started server")
    logging.getLogger("procrastinate.worker").warning("odd")
    with warnings.catch_warnings():
        warnings.simplefilter("default")
        warnings.warn("old", UserWarning, stacklevel=1)
    lines = [json.loads(line) for line in written.getvalue().splitlines()]
    assert [line["logger"] for line in lines] == ["uvicorn.error", "procrastinate.worker", "py.warnings"]
    assert lines[0]["event"] == "Exception in ASGI"


def test_nothing_begins_a_line_of_its_own_or_speaks_to_a_terminal(begin: Begin) -> None:
    """A path may be `/x%0a2026-11-23T04:00:00Z INFO ...`, a name may hold the control characters of a terminal."""
    written = begin()
    odd = "a\nb\x1b[31m\x9b2J\u2028c\u202ed"
    logging.getLogger("app.x").error("GET %s: no answer", odd)
    tell(logger, "drive done", reason=odd)
    first, second = written.getvalue().split("\n")[:-1]
    assert first.endswith(r"GET /: no answer".replace("/", r"a\nb\x1b[31m\x9b2J\u2028c\u202ed"))
    assert second.isprintable()


def test_what_libraries_say_of_each_step_is_told_at_debug_alone(begin: Begin) -> None:
    written = begin(log_level="DEBUG")
    logging.getLogger("uvicorn.error").debug("a step")
    assert "a step" in written.getvalue()


def test_beginning_twice_logs_once(begin: Begin) -> None:
    begin()
    written = begin()
    tell(logger, "once")
    assert written.getvalue().count("once") == 1


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("no road near 49.01234, -8.40001", "no road near (blanked), (blanked)"),
        ("[8.4611,48.9512]", "[(blanked),(blanked)]"),
        ("took 12.345 s on 127.0.0.1 by 2.10.4", "took 12.345 s on 127.0.0.1 by 2.10.4"),
        ("2026-11-23T04:00:00.123Z 1700000000.12345", "2026-11-23T04:00:00.123Z 1700000000.12345"),
        (
            "Failing row contains (0101000020E61000001B2FDD2406A12040B29DEFA7C6834840)",
            "Failing row contains ((blanked))",
        ),
        ("sha 9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08", None),
    ],
)
def test_what_could_be_a_place_is_blanked(text: str, expected: str | None) -> None:
    assert blanked(text) == (expected or text)


def test_places_are_blanked_in_tracebacks(begin: Begin) -> None:
    written = begin()
    try:
        raise ValueError("the box 8.46119,48.95123")
    except ValueError:
        logger.exception("it failed")
    assert "48.95" not in written.getvalue()
    assert "the box (blanked),(blanked)" in written.getvalue()
