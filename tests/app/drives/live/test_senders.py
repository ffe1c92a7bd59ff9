"""Every program's messages, and what each has to bring along."""

from __future__ import annotations

import base64
import json
import re
from urllib.parse import parse_qs, urlsplit

import pytest

from app.core.errors import BadRequestError
from app.drives.live.points import Batch, moment_us
from app.drives.live.senders import SENDERS
from app.drives.live.senders.base import Message
from live_senders import ABOVE_SEA, APPLE, BEGAN_S, SAMPLES, owntracks, way
from live_support import near
from source_tree import REPOSITORY

NOW_US = (BEGAN_S + 3600) * 1_000_000
WITHOUT_PRESSURE = set(SENDERS) - {"owntracks", "sensor-logger"}


def read(sender: str, *messages: Message) -> Batch:
    batch = Batch(NOW_US)
    for message in messages:
        SENDERS[sender].read(message, batch)
    return batch


@pytest.mark.parametrize("sender", SENDERS)
def test_a_programs_messages_hold_what_its_device_measured(sender: str) -> None:
    points = way(25)
    batch = read(sender, *(one.message for one in SAMPLES[sender](points, "pixel")))
    assert list(batch.points) == ["pixel"]
    assert batch.unusable == 0
    for found, sent in zip(sorted(batch.points["pixel"]), points, strict=True):
        assert (found.time_us, found.lat_deg, found.lon_deg) == (sent.time_us, sent.lat_deg, sent.lon_deg)
        height = found.alt_msl_m if sender in ABOVE_SEA else found.height_ell_m
        assert (height, found.heading_deg) == (sent.height_ell_m, sent.heading_deg)
        assert (found.alt_msl_m is None) == (sender not in ABOVE_SEA)
        for name in ("h_acc_m", "v_acc_m", "speed_mps", "s_acc_mps", "pressure_hpa"):
            assert near(getattr(found, name), getattr(sent, name)), name
        assert near(found.speed_mps, 15.0)
        assert found.speed_mps is not None
        assert (found.pressure_hpa is None) == (sender in WITHOUT_PRESSURE)
        assert (found.odo_speed_mps is not None) == (sender == "torque")


@pytest.mark.parametrize("sender", SENDERS)
def test_every_program_has_a_sample_a_guide_and_words_in_both_languages(sender: str) -> None:
    guide = (REPOSITORY / "docs/how-to/record.md").read_text()
    assert f"| **{SENDERS[sender].title}** |" in guide
    assert f"`{sender}`" in guide
    for language in ("en", "de"):
        texts = json.loads((REPOSITORY / f"app/web/src/texts/{language}.json").read_text())
        assert texts["phones"]["steps"][sender.replace("-", "_")], language
    assert sender in SAMPLES
    assert re.fullmatch(r"[a-z-]+", sender)


def test_what_programs_write_for_nothing_is_nothing() -> None:
    (message,) = owntracks(way(1), "x")
    plain = json.loads(message.content) | {"alt": -99999, "cog": -1, "acc": 0, "vel": "fast", "p": True}
    (point,) = read("owntracks", Message(body=json.dumps(plain).encode())).points["x"]
    assert point[3:] == (None, None, None, 3.0, None, None, None, None, None)


def test_heights_of_apples_phones_are_above_the_sea() -> None:
    (message,) = owntracks(way(1), "x")
    (point,) = read("owntracks", Message({}, message.content, {"user-agent": APPLE})).points["x"]
    assert (point.alt_msl_m, point.height_ell_m) == (300.0, None)


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b'{"_type": "transition", "tst": 1, "lat": 1, "lon": 1, "event": "enter"}',
        b'{"_type": "waypoint", "desc": "home", "lat": 48.1, "lon": 8.2, "rad": 50, "tst": 1764231300}',
        b'{"_type": "lwt", "tst": 1764231300}',
        b'{"_type": "dump"}',
        b"[]",
    ],
)
def test_what_holds_no_place_is_taken_and_passed_over(body: bytes) -> None:
    batch = read("owntracks", Message(body=body))
    assert batch.is_empty
    assert batch.unusable == 0


@pytest.mark.parametrize(
    ("sender", "body"),
    [
        ("owntracks", b'{"_type": "locat'),
        ("owntracks", b'"x"'),
        ("overland", b'{"locations": 3}'),
        ("overland", b"[1]"),
        ("traccar", b'{"device": {}}'),
        ("sensor-logger", b'{"payload": {}}'),
        ("gpslogger", b"[1]"),
        ("osmand", b'{"lat": 48'),
    ],
)
def test_what_is_cut_or_of_another_program_is_refused(sender: str, body: bytes) -> None:
    with pytest.raises(BadRequestError):
        read(sender, Message(body=body))


@pytest.mark.parametrize(
    ("fields", "why"),
    [
        ({"timestamp": "1"}, "point 1: time: 1"),
        ({"timestamp": str(BEGAN_S + 200_000)}, f"point 1: time: {BEGAN_S + 200_000}"),
        ({"timestamp": ""}, "point 1: time: "),
        ({"lat": "91"}, "point 1: latitude: 91"),
        ({"lat": "nan"}, "point 1: latitude: nan"),
        ({"lon": "-180.1"}, "point 1: longitude: -180.1"),
        ({"lat": "0", "lon": "0.0"}, "point 1: place: 0, 0"),
    ],
)
def test_a_point_that_cannot_be_is_counted_and_said(fields: dict[str, str], why: str) -> None:
    good = {"lat": "48.1", "lon": "8.2", "timestamp": str(BEGAN_S)}
    batch = read("osmand", Message(good | fields))
    assert (batch.is_empty, batch.unusable, batch.why) == (True, 1, why)
    assert not read("osmand", Message(good)).is_empty


def test_one_message_may_not_hold_any_number() -> None:
    sent = [{"lat": 48, "lon": 8, "time": BEGAN_S}] * 10_001
    with pytest.raises(BadRequestError, match="10000"):
        read("gpslogger", Message(body=json.dumps(sent).encode()))


@pytest.mark.parametrize(
    ("value", "seconds"),
    [
        (1764231300, 1764231300.0),
        ("1764231300.25", 1764231300.25),
        (1764231300250, 1764231300.25),
        ("1764231300250", 1764231300.25),
        (1764231300250000000, 1764231300.25),
        ("2025-11-27T08:15:00.250Z", 1764231300.25),
        ("2025-11-27T01:15:00-0700", 1764231300.0),
        ("2025-11-27 08:15:00", 1764231300.0),
        ("2025-11-27T08:15:00.250+00:00", 1764231300.25),
    ],
)
def test_times_are_read_in_every_form(value: object, seconds: float) -> None:
    assert moment_us(value) == round(seconds * 1e6)


@pytest.mark.parametrize("value", [None, "", "today", True, "1e400", [], "9" * 400])
def test_what_is_no_time_is_none(value: object) -> None:
    found = moment_us(value)
    assert found is None or found > 10**20  # which no point may have


def test_links_set_programs_up() -> None:
    address = "https://slopes.example/v1/live/owntracks/vsk_x"
    own = SENDERS["owntracks"].link
    over = SENDERS["overland"].link
    assert own is not None
    assert over is not None
    inline = parse_qs(urlsplit(own(address, "my phone")).query)["inline"][0]
    settings = json.loads(base64.b64decode(inline, validate=True))
    assert (settings["url"], settings["mode"], settings["_type"]) == (address, 3, "configuration")
    assert "my%20phone" in over(address, "my phone")
    setup = parse_qs(urlsplit(over(address, "my phone")).query)
    assert setup == {"url": [address], "device_id": ["my phone"]}
