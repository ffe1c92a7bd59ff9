"""Quotas: counted with the drive, never passed together, told before a body is read."""

from __future__ import annotations

import re
import socket
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from sqlalchemy import create_engine, text
from sqlalchemy.exc import ProgrammingError

from access_support import Keyed, asking_for_keys
from app.access import quotas, store
from app.core.caller import SERVICE, Caller, as_caller, guard
from app.core.db import Sessions, session_factory
from app.core.settings import Settings
from problem_support import check

NOON = datetime(2026, 11, 27, 12, 0, 0, tzinfo=UTC)
NEXT_DAY = datetime(2026, 11, 28, 0, 0, 1, tzinfo=UTC)
QUOTA_DRIVES, QUOTA_BYTES, QUOTA_RECORDS = 3, 1000, 500


def log(number: int, size: int = 60) -> bytes:
    """The log of a drive of so many bytes."""
    return f"time_s,lat_deg,lon_deg\n{1_700_000_000 + number},49.0,8.4\n".encode().ljust(size, b"\n")


class Uploads:
    """A service with quotas, and what is sent to it."""

    def __init__(self, guarded: Keyed) -> None:
        self.ask, self.web, self.secrets = guarded.ask, guarded.web, guarded.secrets
        self.owner_id = guarded.owners["anna"]

    def send(self, content: Any, caller: str = "anna upload") -> httpx.Response:
        return self.ask(caller, "POST", "/v1/drives", content=content)

    def use(self) -> list[tuple[Any, ...]]:
        with self.web.sessions() as session:
            rows = session.execute(text("SELECT owner_id, day, drives, bytes FROM owner_use ORDER BY 1, 2"))
            return [tuple(row) for row in rows]

    def read(self, records: int) -> None:
        """A worker reads logs of so many records."""
        with self.web.sessions.begin() as session:
            quotas.count_records(session, self.owner_id, quotas.utc_now().date(), records)

    def blobs(self) -> int:
        return len(self.web.blobs.keys())


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Callable[[datetime], None]:
    """Sets the clock of quotas."""

    def set_clock(now: datetime) -> None:
        monkeypatch.setattr(quotas, "utc_now", lambda: now)
        monkeypatch.setattr("app.access.routes.utc_now", lambda: now)

    set_clock(NOON)
    return set_clock


@pytest.fixture
def service(settings: Settings, clock: object) -> Iterator[Uploads]:
    changed = {"quota_drives": QUOTA_DRIVES, "quota_bytes": QUOTA_BYTES, "quota_records": QUOTA_RECORDS}
    with asking_for_keys(settings, **changed) as guarded:
        yield Uploads(guarded)


def test_uploads_are_counted_and_told(service: Uploads) -> None:
    answer = service.send(log(1, 200))
    assert answer.status_code == 202, answer.text
    assert answer.headers["ratelimit-policy"] == (
        '"drives";q=3;w=86400, "bytes";q=1000;qu="content-bytes";w=86400, "records";q=500;qu="records";w=86400'
    )
    assert answer.headers["ratelimit"] == (
        '"drives";r=2;t=43200, "bytes";r=800;t=43200, "records";r=500;t=43200'
    )
    again = service.send(log(1, 200))
    assert again.status_code == 200
    assert again.headers["ratelimit"] == answer.headers["ratelimit"]
    assert service.send(b"no log", caller="anna").status_code == 415
    assert service.use() == [(service.owner_id, NOON.date(), 1, 200)]


def test_the_drive_too_many_is_refused_and_costs_nothing(service: Uploads) -> None:
    for number in range(QUOTA_DRIVES):
        assert service.send(log(number)).status_code == 202
    refused = service.send(log(9))
    problem = check(refused, 429)
    assert problem["type"] == "/problems/quota"
    assert problem["detail"] == (
        "You may upload 3 drives a day: 3 were uploaded today, this is 1 more. The count begins anew at "
        "2026-11-28 00:00 UTC. Send it again then."
    )
    assert refused.headers["retry-after"] == "43200"
    assert refused.headers["ratelimit"].startswith('"drives";r=0;t=43200, ')
    assert service.use() == [(service.owner_id, NOON.date(), QUOTA_DRIVES, 3 * 60)]
    assert service.blobs() == QUOTA_DRIVES
    assert service.send(log(9), caller="ben").status_code == 202, "each owner has its own"
    refusals = service.ask("operate", "GET", "/metrics").text
    assert 'versant_uploads_refused_total{quota="drives"} 1.0' in refusals


def test_no_upload_begins_when_records_are_used_up(
    service: Uploads, clock: Callable[[datetime], None]
) -> None:
    service.read(QUOTA_RECORDS - 1)
    assert service.send(log(1)).headers["ratelimit"].endswith('"records";r=1;t=43200')
    service.read(70)
    refused = service.send(log(2))
    assert check(refused, 429)["detail"] == (
        "You may upload 500 records a day: 569 were uploaded today. The count begins anew at 2026-11-28 00:00 UTC. "
        "Send it again then."
    )
    assert refused.headers["retry-after"] == "43200"
    assert refused.headers["ratelimit"].endswith('"records";r=0;t=43200')
    assert service.blobs() == 1
    assert service.send(log(2), caller="ben").status_code == 202, "each owner has its own"
    assert 'refused_total{quota="records"} 1.0' in service.ask("operate", "GET", "/metrics").text
    clock(NEXT_DAY)
    assert service.send(log(2)).status_code == 202


def test_a_removed_drive_stays_counted(service: Uploads) -> None:
    for number in range(QUOTA_DRIVES):
        place = urlsplit(service.send(log(number)).headers["location"]).path
        assert service.ask("anna", "DELETE", place).status_code in {202, 204}
    assert service.send(log(9)).status_code == 429


def test_the_next_day_begins_anew(service: Uploads, clock: Callable[[datetime], None]) -> None:
    for number in range(QUOTA_DRIVES):
        service.send(log(number))
    assert service.send(log(8)).status_code == 429
    clock(NEXT_DAY)
    answer = service.send(log(9))
    assert answer.status_code == 202
    assert answer.headers["ratelimit"].startswith('"drives";r=2;t=86399, ')
    assert [(day.isoformat(), drives) for _, day, drives, _ in service.use()] == [
        ("2026-11-27", 3),
        ("2026-11-28", 1),
    ]


@pytest.mark.parametrize("shape", ["body", "form"])
def test_exactly_the_quota_of_bytes_is_taken(service: Uploads, shape: str) -> None:
    def send(content: bytes) -> httpx.Response:
        if shape == "body":
            return service.send(content)
        return service.ask("anna upload", "POST", "/v1/drives", files={"file": ("a.csv", content)})

    assert send(log(1, 600)).status_code == 202
    problem = check(send(log(2, 401)), 429)
    assert "1000 bytes a day: 600 were uploaded today, this is 401 more." in problem["detail"]
    assert send(log(3, 400)).status_code == 202
    assert service.use() == [(service.owner_id, NOON.date(), 2, 1000)]


def test_what_no_day_has_room_for_is_not_to_be_sent_again(service: Uploads) -> None:
    problem = check(service.send(log(1, 1001)), 429)
    assert problem["detail"].endswith("Send less, or ask whoever runs the service for more.")


@pytest.mark.parametrize(("size", "records"), [(5000, 0), (50, QUOTA_RECORDS)])
def test_a_refused_body_is_not_read(service: Uploads, size: int, records: int) -> None:
    service.read(records)
    place, key = urlsplit(service.web.base), service.secrets["anna upload"]
    head = (
        f"POST /v1/drives HTTP/1.1\r\nHost: {place.netloc}\r\nAuthorization: Bearer {key}\r\n"
        f"Content-Length: {size}\r\n\r\n"
    )
    with socket.create_connection((place.hostname, place.port), timeout=30) as connection:
        connection.sendall(head.encode())
        answer = connection.makefile("rb").read()  # nothing of the body is ever sent
    assert answer.startswith(b"HTTP/1.1 429")
    assert b"\r\nretry-after: 43200\r\n" in answer.lower()
    assert service.use() == [(service.owner_id, NOON.date(), 0, 0)]
    assert service.blobs() == 0


def test_a_body_of_unknown_length_is_counted_when_it_has_come(service: Uploads) -> None:
    answer = service.send(iter([log(1, 300), b"\n" * 300]))
    assert answer.status_code == 202
    assert service.send(iter([log(2, 300), b"\n" * 101])).status_code == 429
    assert service.use() == [(service.owner_id, NOON.date(), 1, 600)]
    assert service.blobs() == 1, "the blob of the refused one is removed"
    with service.web.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM drives")).scalar_one() == 1
        assert session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one() == 1


def test_uploads_at_once_do_not_pass_together(service: Uploads) -> None:
    with ThreadPoolExecutor(8) as pool:
        statuses = [answer.status_code for answer in pool.map(service.send, map(log, range(16)))]
    assert sorted(statuses) == [202] * QUOTA_DRIVES + [429] * (16 - QUOTA_DRIVES)
    assert service.use() == [(service.owner_id, NOON.date(), QUOTA_DRIVES, 60 * QUOTA_DRIVES)]
    assert service.blobs() == QUOTA_DRIVES


def test_the_operator_has_no_quota_but_its_own(service: Uploads) -> None:
    for number in range(QUOTA_DRIVES + 1):
        answer = service.send(log(number), caller="operate")
        assert answer.status_code == 202
        assert "ratelimit" not in answer.headers
    assert service.ask("operate", "PATCH", "/v1/owners/1", json={"quota_drives": 4}).status_code == 200
    assert service.send(log(9), caller="operate").status_code == 429


def test_whoever_operates_has_no_quota_of_all(service: Uploads) -> None:
    with service.web.sessions.begin() as session:
        _, service.secrets["anna operates"] = store.create_key(session, service.owner_id, "x", "operate")
    for number in range(QUOTA_DRIVES + 1):
        assert service.send(log(number), caller="anna operates").status_code == 202
    assert service.ask("anna operates", "GET", "/v1/owner").json()["today"]["quota_drives"] is None
    assert (
        service.ask("operate", "GET", f"/v1/owners/{service.owner_id}").json()["today"]["quota_drives"] == 3
    )
    assert service.send(log(9)).status_code == 429, "what was sent as an operator counts"


def test_an_owner_has_quotas_of_its_own(service: Uploads) -> None:
    path = f"/v1/owners/{service.owner_id}"
    changed = service.ask("operate", "PATCH", path, json={"quota_drives": 1})
    assert changed.status_code == 200
    assert changed.json()["quota_drives"] == changed.json()["today"]["quota_drives"] == 1
    assert changed.json()["today"]["quota_bytes"] == QUOTA_BYTES
    assert service.send(log(1)).status_code == 202
    assert service.send(log(2)).status_code == 429
    assert service.send(log(1), caller="ben").headers["ratelimit"].startswith('"drives";r=2;')
    service.ask("operate", "PATCH", path, json={"quota_bytes": 50})
    assert service.ask("operate", "GET", path).json()["quota_drives"] == 1, "what is not named stays"
    unset = service.ask("operate", "PATCH", path, json={"quota_drives": None, "quota_bytes": None}).json()
    assert unset["quota_drives"] is None
    assert unset["today"]["quota_drives"] == QUOTA_DRIVES
    assert service.send(log(2)).status_code == 202
    audited = service.ask("operate", "GET", "/v1/admin/audit").json()["rows"]
    assert [row["action"] for row in audited].count("quotas changed") == 3


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"quota_drives": -1}, "quota_drives"),
        ({"quota_bytes": 10**15}, "quota_bytes"),
        ({"quota_drives": "many"}, "quota_drives"),
        ({"quota_records": 1.5}, "quota_records"),
        ({"name": "x"}, "name"),
    ],
)
def test_quotas_that_cannot_be(service: Uploads, change: dict[str, Any], field: str) -> None:
    problem = check(service.ask("operate", "PATCH", f"/v1/owners/{service.owner_id}", json=change), 422)
    assert [error["field"] for error in problem["errors"]] == [field]


def test_an_owner_sees_its_own_figures_and_nobody_else_s(service: Uploads) -> None:
    service.send(log(1, 100))
    service.send(log(1, 90), caller="ben")
    service.read(7)
    document = service.ask("anna", "GET", "/v1/owner").json()
    assert document == {
        "id": service.owner_id,
        "name": "anna",
        "created_at": document["created_at"],
        "removed_at": None,
        "keys": 2,
        "drives": 1,
        "bytes": 100,
        "quota_drives": None,
        "quota_bytes": None,
        "quota_records": None,
        "keep_logs_days": None,
        "logs_kept_days": None,
        "today": {
            "day": "2026-11-27",
            "drives": 1,
            "bytes": 100,
            "records": 7,
            "quota_drives": QUOTA_DRIVES,
            "quota_bytes": QUOTA_BYTES,
            "quota_records": QUOTA_RECORDS,
            "until": "2026-11-28T00:00:00Z",
        },
    }
    path = f"/v1/owners/{service.owner_id}"
    assert service.ask("operate", "GET", path).json() == document
    check(service.ask("anna", "GET", path), 403)
    check(service.ask("anna", "PATCH", path, json={}), 403)
    check(service.ask("anna upload", "GET", "/v1/owner"), 403)
    check(service.ask("operate", "GET", "/v1/owners/999"), 404)
    check(service.ask("operate", "PATCH", "/v1/owners/999", json={}), 404)


def test_nothing_is_said_of_quotas_where_there_are_none(web: Any) -> None:
    answer = web.client.post("/v1/drives", content=log(1))
    assert answer.status_code == 202
    assert not [name for name in answer.headers if re.match("ratelimit|retry", name)]
    today = web.client.get("/v1/owner").json()["today"]
    assert (today["drives"], today["quota_drives"], today["quota_bytes"]) == (1, None, None)


@pytest.fixture
def sessions_of_callers(database_url: str) -> Iterator[Sessions]:
    """Sessions as the API has them, two owners with some use."""
    engine = create_engine(database_url)
    with session_factory(engine).begin() as session:
        for name in ("bus fleet", "tram fleet"):
            store.create_owner(session, name)
        session.execute(text("INSERT INTO owner_use SELECT id, '2026-11-27', 5, 50 FROM owners"))
    yield session_factory(guard(engine))
    engine.dispose()


@pytest.mark.parametrize(
    ("caller", "seen"),
    [(SERVICE, [1, 2, 3]), (Caller("own", 2), [2]), (Caller("upload", 2), []), (Caller(), [])],
)
def test_use_is_shown_to_whose_it_is(sessions_of_callers: Sessions, caller: Caller, seen: list[int]) -> None:
    with as_caller(caller), sessions_of_callers() as session:
        assert list(session.execute(text("SELECT owner_id FROM owner_use ORDER BY 1")).scalars()) == seen


def test_nobody_counts_for_another(sessions_of_callers: Sessions) -> None:
    insert = text("INSERT INTO owner_use VALUES (3, '2026-11-28', 1, 1)")
    update = text("UPDATE owner_use SET drives = 0 WHERE owner_id = 3")
    with as_caller(Caller("own", 2)):
        with sessions_of_callers() as session, pytest.raises(ProgrammingError, match="row-level security"):
            session.execute(insert)
        with sessions_of_callers() as session, pytest.raises(ProgrammingError, match="row-level security"):
            quotas.count_records(session, 3, NOON.date(), 9)
        with sessions_of_callers.begin() as session:
            assert session.execute(update).rowcount == 0  # type: ignore[attr-defined]
