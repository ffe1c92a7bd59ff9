"""The audit log: a row for each removal and for what is asked for in bulk, none for what changed nothing."""

from __future__ import annotations

import uuid
from typing import Any

from sqlalchemy import text

from access_support import Keyed
from app.core.telemetry import audit
from processing_support import HEADER
from web_fixtures import Web, add_drive


def logged(web: Web) -> list[dict[str, Any]]:
    """The oldest first."""
    return list(reversed(web.client.get("/v1/admin/audit").json()["rows"]))


def test_what_is_removed_over_http_leaves_a_row(filled: Web) -> None:
    drive = add_drive(filled.sessions, [0, 1])
    assert filled.client.delete(f"/v1/drives/{drive}").status_code == 202
    for _ in range(2):  # the second time there is nothing to remove
        assert filled.client.delete(f"/v1/drives/{drive}").status_code == 404
    assert filled.client.delete(f"/v1/drives/{uuid.uuid4()}").status_code == 404
    export = filled.client.post("/v1/exports", json={"format": "csv"}).json()["id"]
    for _ in range(2):
        assert filled.client.delete(f"/v1/exports/{export}").status_code == 204
    rows = logged(filled)
    assert [(row["action"], row["subject"]) for row in rows] == [
        ("drive removed", str(drive)),
        ("export removed", export),
    ]
    assert rows[0]["detail"] == {}
    assert rows[0]["origin"].startswith("127.0.0.1 python-httpx/")
    assert rows[0]["at"].endswith("Z")


def test_what_is_asked_for_in_bulk_leaves_a_row_and_a_dry_run_none(filled: Web) -> None:
    add_drive(filled.sessions, [0, 1])
    asked = {"which": "all", "dry_run": "true"}
    assert filled.client.post("/v1/drives/reprocess", params=asked).status_code == 200
    assert filled.client.delete("/v1/drives/reprocess", params={"batch": 77}).status_code == 404
    assert logged(filled) == []
    answer = filled.client.post("/v1/drives/reprocess", params={"which": "all"})
    batch = answer.headers["location"].rpartition("=")[2]
    filled.client.delete("/v1/drives/reprocess", params={"batch": batch})
    assert [(row["action"], row["subject"], row["detail"]) for row in logged(filled)] == [
        ("drives asked for again", f"batch {batch}", {"which": "all"}),
        ("batch cancelled", f"batch {batch}", {}),
    ]


def test_a_program_s_name_is_kept_short_and_plain_and_csv_holds_it(filled: Web) -> None:
    drive = add_drive(filled.sessions, [0])
    with filled.sessions.begin() as session:
        session.execute(text("UPDATE drives SET filename = 'a\"b,c' WHERE id = :id"), {"id": drive})
    filled.client.delete(f"/v1/drives/{drive}", headers={"User-Agent": "y" * 500})
    (row,) = logged(filled)
    assert row["origin"] == "127.0.0.1 " + "y" * 80
    assert row["detail"] == {}
    table = filled.client.get("/v1/admin/audit?f=csv").text
    assert table.splitlines()[0] == "at,action,subject,detail,origin,owner,key"
    assert len(table.splitlines()) == 2


def test_only_the_latest_rows_are_kept(filled: Web) -> None:
    with filled.sessions.begin() as session:
        for k in range(5):
            audit.note(session, "somebody", "asked", k)
        audit.prune(session, most=2)
    assert [row["subject"] for row in logged(filled)] == ["3", "4"]


def test_a_row_says_whose_key_it_was(keyed: Keyed) -> None:
    drives = [
        holder.post("/v1/drives", content=HEADER).json()["id"] for holder in (keyed.a.own, keyed.operator)
    ]
    for holder, drive in zip((keyed.a.own, keyed.operator), drives, strict=True):
        assert holder.delete(f"/v1/drives/{drive}").status_code == 202
    rows = list(reversed(keyed.operator.get("/v1/admin/audit").json()["rows"]))
    assert [(row["owner"], row["key"]) for row in rows] == [
        ("anna", str(keyed.a.own.key_id)),
        ("operator", str(keyed.operator.key_id)),
    ]
    assert rows[0]["origin"].startswith("127.0.0.1 python-httpx/")
    for holder in (keyed.a.own, keyed.a.upload):
        assert holder.get("/v1/admin/audit").status_code == 403
