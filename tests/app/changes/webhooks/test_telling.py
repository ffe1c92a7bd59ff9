"""Messages, from what they tell of until they are taken or given up."""

from __future__ import annotations

import base64
import hashlib
import hmac
import threading
import time

import pytest
from sqlalchemy import text

from app.changes.webhooks import store, telling
from app.changes.webhooks.store import PAUSES_S
from app.changes.webhooks.telling import Teller, note_changes
from app.drives.process import give_up
from receiver import receiving
from web_fixtures import Web, add_drive
from webhook_support import ELSEWHERE, GRID, add, change, followed, later, seen, send_due, waiting_drive


def test_a_test_message_arrives_signed_and_is_shown(told: Web) -> None:
    with receiving() as receiver:
        made = add(told, receiver.url, "drive.done")
        asked = told.client.post(f"/v1/webhooks/{made['id']}/test")
        assert asked.status_code == 202
        assert send_due(told) == 1
        ((headers, body),) = receiver.got
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
        key = base64.b64decode(made["secret"].removeprefix("whsec_"))
        digest = base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
        assert headers["webhook-signature"] == f"v1,{digest}"
        assert abs(int(headers["webhook-timestamp"]) - time.time()) < 60
        assert receiver.documents[0]["type"] == "test"
        one = seen(told, made)
        assert (one["deliveries"][0]["id"], one["deliveries"][0]["state"]) == (
            asked.json()["delivery"],
            "taken",
        )
        assert one["last_success_at"] is not None


def test_a_follower_is_told_once_of_all_that_came_and_from_where_to_read_it(told: Web) -> None:
    with receiving(500) as receiver:
        add(told, receiver.url)
        change(told, 1, 2)
        change(told, 2, 3)
        assert note_changes(told.sessions, 0) == 1
        assert note_changes(told.sessions, 0) == 0, "one waits"
        assert send_due(told) == 1, "not taken"
        change(told, 9)
        assert note_changes(told.sessions, 0) == 0, "the first one waits still, and is sent again as it is"
        later(told, 10)
        assert send_due(told) == 1
        first, again = (headers["webhook-id"] for headers, _ in receiver.got)
        assert first == again
        data = receiver.documents[1]["data"]
        assert receiver.documents[0]["data"] == data
        assert (data["segments"], data["gone"], data["counted_all"]) == (3, 0, True)
        assert followed(told, data["since"]) == [1, 2, 3, 9]

        assert note_changes(told.sessions, 3600) == 0, "not so often"
        assert note_changes(told.sessions, 0) == 1
        send_due(told)
        more = receiver.documents[2]["data"]
        assert more["since"] == data["version"]
        assert followed(told, more["since"]) == [9]
        assert note_changes(told.sessions, 0) == 0


def test_a_follower_of_a_part_is_told_of_that_part(told: Web) -> None:
    with receiving() as receiver:
        for box in (GRID, ELSEWHERE):
            add(told, receiver.url, bbox=box)
        change(told, 1)
        assert note_changes(told.sessions, 0) == 1
        assert send_due(told) == 1
        change(told, 1)
        with told.sessions() as session:
            versions = {tuple(one.bbox or ()): one.reported_version for one in store.list_webhooks(session)}
        assert versions[tuple(GRID)] == versions[tuple(ELSEWHERE)], (
            "who was not concerned goes on from there as well"
        )


def test_a_follower_of_a_restored_database_is_told_to_begin_anew(told: Web) -> None:
    with receiving() as receiver:
        add(told, receiver.url)
        with told.sessions.begin() as session:
            session.execute(text("UPDATE change_epoch SET place = 'elsewhere', xid = versant_xid()"))
        assert note_changes(told.sessions, 0) == 1
        send_due(told)
        data = receiver.documents[0]["data"]
        assert (data["since"], data["segments"]) == (None, None)
        assert followed(told, data["version"]) == []
        assert note_changes(told.sessions, 0) == 0


def test_drives_are_told_when_they_are_done_or_failed_where_they_were(told: Web) -> None:
    with receiving() as receiver:
        add(told, receiver.url, "drive.done", "drive.failed", bbox=GRID)
        done = add_drive(told.sessions, [0, 1])
        failed, far = (waiting_drive(told, box) for box in ((8.4, 49.0, 8.5, 49.1), (20.0, 20.0, 21.0, 21.0)))
        for drive in (failed, far):
            give_up(told.context, drive, 1, "too-long", "It took too long.")
            give_up(told.context, drive, 1, "too-long", "It is told once.")
        assert send_due(told) == 2
        said = {document["type"]: document["data"] for document in receiver.documents}
        assert said["drive.done"]["drive_id"] == str(done)
        assert said["drive.failed"] == {
            "drive_id": str(failed),
            "kind": "too-long",
            "reason": "It took too long.",
        }


def test_what_is_not_taken_comes_later_and_later_until_the_address_is_switched_off(told: Web) -> None:
    with receiving(*[500] * 20) as receiver:
        made = add(told, receiver.url, "drive.done")
        for _ in range(2):
            told.client.post(f"/v1/webhooks/{made['id']}/test").raise_for_status()
        for failures, pause_s in enumerate(PAUSES_S, start=1):
            assert send_due(told) == 1, "the other message waits for the address as well"
            assert seen(told, made)["failures"] == failures
            later(told, pause_s - 1)
            assert send_due(told) == 0
            later(told, 1)
        assert seen(told, made)["active"]
        later(told, 86400 * told.settings.webhook_patience_days)
        assert send_due(told) == 1
        one = seen(told, made)
        assert (one["active"], one["off_reason"]) == (False, "It answered 500.")
        assert {delivery["state"] for delivery in one["deliveries"]} == {"given up"}
        on = told.client.patch(f"/v1/webhooks/{made['id']}", json={"active": True}).raise_for_status().json()
        assert (on["active"], on["off_reason"], on["failures"], on["failing_since"]) == (True, None, 0, None)


def test_one_message_that_is_never_taken_does_not_keep_others_back(told: Web) -> None:
    with receiving(400) as receiver:
        made = add(told, receiver.url, "drive.done")
        for _ in range(2):
            told.client.post(f"/v1/webhooks/{made['id']}/test").raise_for_status()
        assert send_due(told) == 1
        later(told, 4)
        with told.sessions.begin() as session:
            session.execute(text("UPDATE webhooks SET next_at = now()"))
        assert send_due(told) == 1, "the other one; the first is due a second later"
        assert receiver.got[0][0]["webhook-id"] != receiver.got[1][0]["webhook-id"]
        assert seen(told, made)["failures"] == 0


def test_who_answers_that_it_is_gone_is_told_no_more(told: Web) -> None:
    with receiving(410) as receiver:
        made = add(told, receiver.url, "drive.done")
        told.client.post(f"/v1/webhooks/{made['id']}/test").raise_for_status()
        assert send_due(told) == 1
        assert not seen(told, made)["active"]
        add_drive(told.sessions, [3])
        assert [one["event"] for one in seen(told, made)["deliveries"]] == ["test"]


def test_a_message_whose_sender_died_is_sent_again_by_another(told: Web) -> None:
    with receiving() as receiver:
        made = add(told, receiver.url, "drive.done")
        told.client.post(f"/v1/webhooks/{made['id']}/test").raise_for_status()
        with told.sessions.begin() as session:
            assert store.claim(session) is not None
        assert send_due(told) == 0
        with told.sessions.begin() as session:
            session.execute(text("UPDATE webhooks SET claimed_until = now() - interval '1 s'"))
        assert send_due(told) == 1


def test_one_that_hangs_keeps_no_other_waiting(told: Web, monkeypatch: pytest.MonkeyPatch) -> None:
    """With as many places as addresses that hang and one more; and looking takes no time."""
    monkeypatch.setattr(telling, "AT_ONCE", 3)
    monkeypatch.setattr(telling, "EVERY_S", 0)
    slow = told.settings.model_copy(update={"webhook_timeout_s": 20.0})
    with receiving("hang", "hang", "hang") as hanging, receiving() as quick:
        for url in (hanging.url, hanging.url, quick.url):
            made = add(told, url, "segments.changed")
        change(told, 5)
        teller = Teller(told.sessions, slow)
        begun_s = time.monotonic()
        teller.look()
        quick.wait()
        hanging.wait(2)
        for _ in range(3):
            until = time.monotonic() + 10
            while seen(told, made)["last_success_at"] is None and time.monotonic() < until:
                time.sleep(0.02)
            # Before the next is sent: a success that is noted at once must not be wiped out.
            with told.sessions.begin() as session:
                session.execute(text("UPDATE webhooks SET last_success_at = NULL"))
            change(told, 5)
            teller.look()
            quick.wait()
        assert time.monotonic() - begun_s < 15
        teller.close()
        hanging.done.set()
        for thread in [one for one in threading.enumerate() if one.name == "webhook"]:
            thread.join(timeout=20)


def test_messages_that_ended_long_ago_are_forgotten(told: Web) -> None:
    with receiving() as receiver:
        made = add(told, receiver.url, "drive.done")
        for _ in range(2):
            told.client.post(f"/v1/webhooks/{made['id']}/test").raise_for_status()
        assert send_due(told) == 2
        with told.sessions.begin() as session:
            old = "UPDATE webhook_deliveries SET ended_at = now() - interval '8 days' WHERE id = "
            session.execute(text(f"{old} (SELECT id FROM webhook_deliveries LIMIT 1)"))
        telling.prune(told.sessions)
        assert len(seen(told, made)["deliveries"]) == 1


def test_what_is_logged_names_no_address(told: Web, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("DEBUG", "app")
    with receiving(500) as receiver:
        made = add(told, receiver.url, "drive.done", bbox=GRID)
        told.client.post(f"/v1/webhooks/{made['id']}/test").raise_for_status()
        send_due(told)
    assert "webhook sent" in caplog.text
    assert "127.0.0.1" not in caplog.text
    assert "told" not in caplog.text
