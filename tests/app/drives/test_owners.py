"""Whose drives a caller sees: all that the API tells of a drive, it tells its owner and operators alone."""

from __future__ import annotations

import json
import re
import threading
import uuid
from collections.abc import Iterator
from typing import Any

import pytest
from sqlalchemy import event, text

from access_support import Holder, Keyed
from app.access.rules import ROUTES
from app.access.store import create_owner
from app.core.caller import OPERATOR_OWNER, Caller, as_caller, guard
from app.core.db import make_engine, session_factory
from app.core.receiving import sse
from app.drives import claims
from app.drives.batches.store import fold_counts
from app.drives.listing import Order, Sort
from app.drives.process import Outcome
from app.drives.store import list_drives
from app.jobs.context import JobContext
from many_drives import rows
from problem_support import check
from processing_support import HEADER, Send, process_drive
from server_support import wait_until
from web_fixtures import add_drive

LOG, OTHER = HEADER + b"1,49,8\n", HEADER + b"2,49,8\n"


def sent(holder: Holder, log: bytes = LOG, status: int = 202) -> str:
    answer = holder.post("/v1/drives?method=raw", content=log)
    assert answer.status_code == status, answer.text
    return str(answer.json()["id"])


def listed(holder: Holder, query: str = "") -> list[str]:
    return [drive["id"] for drive in holder.get(f"/v1/drives{query}").json()["drives"]]


def test_the_same_log_is_a_drive_of_each_owner(keyed: Keyed) -> None:
    of_a, of_b = sent(keyed.a.own), sent(keyed.b.own)
    assert of_a != of_b
    assert sent(keyed.a.own, status=200) == of_a
    assert sent(keyed.a.upload, status=200) == of_a
    assert sent(keyed.b.upload, status=200) == of_b
    of_operator = sent(keyed.operator)  # who sees all three, and has none of them
    assert of_operator not in {of_a, of_b}
    assert sent(keyed.operator, status=200) == of_operator
    assert sent(keyed.a.own, status=200) == of_a
    assert sorted(listed(keyed.operator)) == sorted([of_a, of_b, of_operator])


def test_a_lost_file_is_given_to_one_s_own_drive(keyed: Keyed) -> None:
    of_a, of_b = sent(keyed.a.own), sent(keyed.b.own)
    with keyed.web.sessions() as session:
        rows = session.execute(text("SELECT CAST(id AS text) AS id, blob_key FROM drives"))
        keys = {row.id: row.blob_key for row in rows}
    keyed.web.blobs.delete(keys[of_a])
    assert keyed.a.own.get(f"/v1/drives/{of_a}/log").status_code == 404
    assert sent(keyed.b.upload, status=200) == of_b
    assert keyed.a.own.get(f"/v1/drives/{of_a}/log").status_code == 404
    assert sent(keyed.a.upload, status=200) == of_a
    assert keyed.a.own.get(f"/v1/drives/{of_a}/log").content == LOG


def test_an_upload_key_follows_what_it_sent_and_nothing_else(keyed: Keyed) -> None:
    mine, others = sent(keyed.a.upload), sent(keyed.a.own, OTHER)
    document = keyed.a.upload.get(f"/v1/drives/{mine}").json()
    assert [one["rel"] for one in document["links"]] == ["self", "events"]
    whole = keyed.a.own.get(f"/v1/drives/{mine}").json()
    assert {**document, "links": []} == {**whole, "links": []}
    strangers = sent(keyed.b.upload, OTHER)
    for path in ("", "/events"):
        for drive in (others, strangers):
            check(keyed.a.upload.get(f"/v1/drives/{drive}{path}"), 404)
        check(keyed.b.upload.get(f"/v1/drives/{mine}{path}"), 404)
        check(keyed.a.upload.get(f"/v1/drives/{uuid.uuid4()}{path}"), 404)
    # Who has the log may follow it: the key that sent it last.
    assert sent(keyed.a.upload, OTHER, 200) == others
    assert keyed.a.upload.get(f"/v1/drives/{others}").status_code == 200
    second = keyed.holder(keyed.a.id, "upload")
    assert sent(second, status=200) == mine
    assert second.get(f"/v1/drives/{mine}").status_code == 200
    check(keyed.a.upload.get(f"/v1/drives/{mine}"), 404)


def contradict(keyed: Keyed, drive: str) -> None:
    """Let the drive's one pass be rejected."""
    with keyed.web.sessions.begin() as session:
        for statement in (
            """
            INSERT INTO drive_passes (drive_id, segment_id, entered_s, sequence, partition, factor)
            SELECT :id, id, 0, 0, versant_partition(cell), '' FROM segments ORDER BY id LIMIT 1
            """,
            """
            INSERT INTO drive_constants (drive_id, passes, evidence, measurements, epoch_s, partitions)
            SELECT drive_id, 1, '', 1, '', ARRAY[partition] FROM drive_passes WHERE drive_id = :id
            """,
            """
            INSERT INTO rejected_passes (segment_id, pass_id, drive_id)
            SELECT segment_id, id, drive_id FROM drive_passes WHERE drive_id = :id
            """,
        ):
            session.execute(text(statement), {"id": drive})


def test_an_upload_key_reads_the_same_report_as_its_owner(keyed_filled: Keyed) -> None:
    keyed = keyed_filled
    drive = keyed.give(add_drive(keyed.web.sessions, [0, 1, 2]), keyed.a)
    contradict(keyed, drive)
    with keyed.web.sessions.begin() as session:
        session.execute(text("UPDATE drives SET sent_by = :key"), {"key": keyed.a.upload.key_id})
    reports = [holder.get(f"/v1/drives/{drive}").json()["report"] for holder in (keyed.a.upload, keyed.a.own)]
    assert reports[0] == reports[1]
    assert reports[0]["rejected_segments"] == 1


def test_lists_filters_and_pages_are_of_one_s_own_drives(keyed: Keyed) -> None:
    mine = [sent(keyed.a.own, HEADER + f"{k},49,8\n".encode()) for k in range(5)]
    theirs = [sent(keyed.b.upload, HEADER + f"{k},49,8\n".encode()) for k in range(3)]
    assert listed(keyed.a.own) == mine[::-1]
    assert listed(keyed.b.own) == theirs[::-1]
    assert len(listed(keyed.operator)) == 8
    for sort in ("created_at", "drive_time", "distance_m", "filename", "status"):
        found, address = [], f"/v1/drives?limit=2&sort={sort}"
        while address:
            page = keyed.a.own.get(address).json()
            found += [drive["id"] for drive in page["drives"]]
            address = next((one["href"] for one in page["links"] if one["rel"] == "next"), "")
        assert sorted(found) == sorted(mine), sort
    # A place in another's list is but a time and a number: it shows nothing of it.
    place = keyed.b.own.get("/v1/drives?limit=1").json()["links"][1]["href"]
    assert set(listed(keyed.a.own, "?" + place.partition("?")[2])) <= set(mine)
    assert listed(keyed.a.own, f"?q={theirs[0][:8]}") == []
    assert listed(keyed.a.own, f"?q={mine[0][:8]}") == [mine[0]]
    keyed.operator.post("/v1/drives/reprocess?which=all")
    for query in ("?status=queued", "?batch=1", "?failure=no-match"):
        assert set(listed(keyed.a.own, query)) <= set(mine)
    check(keyed.a.upload.get("/v1/drives"), 403)
    check(keyed.web.client.get("/v1/drives"), 401)


def test_counts_are_by_owner_also_when_they_are_added_up(keyed: Keyed) -> None:
    for k in range(3):
        sent(keyed.a.own, HEADER + f"{k},49,8\n".encode())
    sent(keyed.b.own)

    def counted() -> list[int]:
        return [
            one.get("/v1/drives/reprocess").json()["queued"]
            for one in (keyed.a.own, keyed.b.own, keyed.operator)
        ]

    assert counted() == [3, 1, 4]
    with keyed.web.sessions.begin() as session:
        fold_counts(session, most_rows=0)
        rows = session.execute(text("SELECT owner_id, drives FROM drive_counts ORDER BY 1")).all()
    assert [tuple(row) for row in rows] == [(keyed.a.id, 3), (keyed.b.id, 1)]
    assert counted() == [3, 1, 4]
    owners = {one["name"]: one["drives"] for one in keyed.operator.get("/v1/owners").json()["owners"]}
    assert owners == {"operator": 0, "anna": 3, "ben": 1}


OF_DRIVES = sorted((method, path) for method, path in ROUTES if path.startswith("/v1/drives/{drive_id}"))


def told(holder: Holder, method: str, path: str, drive: str, trial: str) -> tuple[int, str]:
    """Status and body of the answer, with the ids that were asked for taken out."""
    answer = holder.client.request(method, path.format(drive_id=drive, trial_id=trial))
    return answer.status_code, answer.text.replace(drive, "DRIVE").replace(trial, "TRIAL")


def test_another_s_drive_is_to_every_route_as_none(keyed_filled: Keyed) -> None:
    keyed = keyed_filled
    drive = keyed.give(add_drive(keyed.web.sessions, [0, 1, 2]), keyed.a)
    trial = keyed.a.own.post(f"/v1/drives/{drive}/trials?method=dem").json()["id"]
    assert len(OF_DRIVES) == 17
    for method, path in OF_DRIVES:
        for holder in (keyed.b.own, keyed.b.upload):
            here = told(holder, method, path, drive, trial)
            nowhere = told(holder, method, path, str(uuid.uuid4()), str(uuid.uuid4()))
            assert here == nowhere, (method, path)
            assert here[0] == (404 if holder is keyed.b.own or (method, path) in FOR_UPLOADS else 403), (
                method,
                path,
            )
        assert told(Holder(0, uuid.uuid4(), "", keyed.web.client), method, path, drive, trial)[0] == 401
    assert keyed.a.own.get(f"/v1/drives/{drive}").json()["status"] == "done"
    for part in (
        "track",
        "profile",
        "segments",
        "measurements",
        "trials",
        f"trials/{trial}",
        "profile?f=png",
    ):
        for holder in (keyed.a.own, keyed.operator):
            assert holder.get(f"/v1/drives/{drive}/{part}").status_code == 200, part


FOR_UPLOADS = {("GET", "/v1/drives/{drive_id}"), ("GET", "/v1/drives/{drive_id}/events")}


def events_of(holder: Holder, drive: str) -> Iterator[dict[str, Any]]:
    """The data of the drive's events."""
    with holder.client.stream("GET", f"/v1/drives/{drive}/events") as answer:
        assert answer.status_code == 200
        for line in answer.iter_lines():
            if line.startswith("data: "):
                yield json.loads(line.removeprefix("data: "))


def document_of(holder: Holder, drive: str) -> Any:
    return holder.get(f"/v1/drives/{drive}").json()


def test_a_duplicate_of_another_owner_s_drive_is_told_to_operators_alone(keyed_filled: Keyed) -> None:
    keyed = keyed_filled
    mine, also_mine = (keyed.give(add_drive(keyed.web.sessions, [0, 1]), keyed.a) for _ in range(2))
    theirs = keyed.give(add_drive(keyed.web.sessions, [0, 1]), keyed.b)
    with keyed.web.sessions.begin() as session:
        change = text("UPDATE drives SET duplicate_of = :other, sent_by = :key WHERE id = :id")
        session.execute(change, {"id": mine, "other": theirs, "key": keyed.a.upload.key_id})
        session.execute(change, {"id": also_mine, "other": mine, "key": None})

    for ask in (document_of, lambda one, drive: next(events_of(one, drive))):
        for holder in (keyed.a.own, keyed.a.upload):
            document = ask(holder, mine)
            assert (document["duplicate_of"], document["same_as"]) == (None, None)
            assert document["report"]["warnings"] == []
            assert theirs not in json.dumps(document)
        assert ask(keyed.a.own, also_mine)["duplicate_of"] == mine
        document = ask(keyed.operator, mine)
        assert (document["duplicate_of"], document["same_as"]) == (theirs, theirs)
        assert theirs in document["report"]["warnings"][0]
    assert theirs not in keyed.a.own.get("/v1/drives").text


def test_a_stream_ends_when_the_key_is_revoked(keyed: Keyed, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sse, "HEARTBEAT_S", 0.2)
    drive, told = sent(keyed.a.upload), list[str]()

    def follow() -> None:
        told.extend(one["status"] for one in events_of(keyed.a.upload, drive))

    follower = threading.Thread(target=follow)
    follower.start()
    with keyed.web.sessions.begin() as session:
        claims.mark_running(session, uuid.UUID(drive), 1)
    wait_until(lambda: told != [] or follower.is_alive())
    assert keyed.a.own.delete(f"/v1/keys/{keyed.a.upload.key_id}").status_code == 204
    follower.join(timeout=10)
    assert not follower.is_alive()
    with keyed.web.sessions.begin() as session:
        claims.mark_failed(session, uuid.UUID(drive), 1, kind="empty-log", reason="No position.", stage=None)
    assert "failed" not in told
    check(keyed.a.upload.get(f"/v1/drives/{drive}/events"), 401)


def test_lists_of_a_small_owner_read_no_more_than_its_drives(keyed: Keyed) -> None:
    """In every order, among very many drives of others."""
    with keyed.web.sessions.begin() as session:
        session.execute(
            text("""
                INSERT INTO drives (id, owner_id, sha256, filename, size_bytes, blob_key, status, method, options,
                                    progress, created_at, drive_time, distance_m)
                SELECT gen_random_uuid(), CASE WHEN k % 2000 = 0 THEN :a ELSE :b END, k, 'log ' || k, 7, 'k', 'queued',
                       'raw', '{}', 0, now() - k * interval '1 second', now(), k FROM generate_series(1, 20000) AS k
            """),
            {"a": keyed.a.id, "b": keyed.b.id},
        )
        session.execute(text("ANALYZE drives"))
    engine = guard(make_engine(str(keyed.web.settings.database_url)))
    asked: list[tuple[str, Any]] = []

    def note(_connection: object, _cursor: object, statement: str, values: Any, *_: object) -> None:
        asked.append((statement, values))

    with as_caller(Caller("own", keyed.a.id)):
        for order in Sort:
            with session_factory(engine)() as session:
                event.listen(engine, "before_cursor_execute", note)
                assert len(list_drives(session, order=Order(order, descending=True))) == 10
                event.remove(engine, "before_cursor_execute", note)
    engine.dispose()
    lists = [(statement, values) for statement, values in asked if "list_key" in statement]
    assert len(lists) >= len(Sort)
    with keyed.web.sessions() as session:
        for statement, values in lists:
            plan = session.connection().exec_driver_sql(f"EXPLAIN (ANALYZE) {statement}", values).scalars()
            lines = "\n".join(plan)
            assert all(int(rows) < 100 for rows in re.findall(r"Rows Removed by Filter: (\d+)", lines)), lines


def test_the_same_log_of_two_owners_counts_once_in_the_map(context: JobContext, send: Send) -> None:
    of_a = send(0, "profile")
    with context.sessions.begin() as session:
        owner = create_owner(session, "A").id
        session.execute(text("UPDATE drives SET owner_id = :owner"), {"owner": owner})
    of_operator = send(0, "profile")
    assert of_operator.id != of_a.id
    for drive in (of_a, of_operator):
        assert process_drive(context, drive.id, drive.generation) is Outcome.DONE
    assert rows(context.sessions, "SELECT DISTINCT drives FROM segment_slopes WHERE drives > 0") == [(1,)]
    # Of equal ones the first to come counts, whichever is solved when.
    assert rows(context.sessions, "SELECT id, duplicate_of FROM drives WHERE duplicate_of IS NOT NULL") == [
        (of_operator.id, of_a.id)
    ]
    engine = guard(make_engine(context.sessions().get_bind().url.render_as_string(hide_password=False)))
    with as_caller(Caller("own", OPERATOR_OWNER)), session_factory(engine)() as session:
        (document,) = list_drives(session)
    assert (document.id, document.duplicate_of) == (of_operator.id, None)
    assert str(of_a.id) not in document.model_dump_json()
    engine.dispose()
