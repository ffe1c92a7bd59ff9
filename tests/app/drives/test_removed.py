"""A removed drive: from the answer on nobody is shown anything of it, and what stays tells nothing of it."""

from __future__ import annotations

import json
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import pytest
from sqlalchemy import text

from app.core.settings import Settings
from app.drives import claims, publishing
from app.drives.process import Outcome
from app.drives.trials.run import TRIAL
from app.drives.worker import run_worker
from app.jobs.requests import run as machine
from app.jobs.task import Interrupted, Work
from app.roads import imports as road_imports
from problem_support import check
from processing_support import carry_out_removals, process_drive
from server_support import wait_until
from web_fixtures import Web, add_drive

NAME = "max.mustermann.csv"
WAITED_S = text("""
    SELECT coalesce(max(extract(epoch FROM clock_timestamp() - query_start)), 0) FROM pg_stat_activity
    WHERE wait_event_type = 'Lock' AND datname = current_database()
""")
"""How long a statement has waited for a lock."""
FOLLOWED = {"/v1/changes/events"}
"""Streams without an end."""


@pytest.fixture
def town_web(web: Web, files: Path) -> Web:
    road_imports.import_roads(web.sessions, files / "town.osm", web.settings.dem_dir)
    return web


@pytest.fixture
def drive(town_web: Web, files: Path) -> str:
    """The id of a drive by the default method that is done."""
    sent = {"file": (NAME, (files / "0.csv").read_bytes())}
    found = str(town_web.client.post("/v1/drives?method=profile", files=sent).json()["id"])
    assert process_drive(town_web.context, uuid.UUID(found), 1) is Outcome.DONE
    return found


def parts(web: Web, **ids: str) -> dict[str, str]:
    """The addresses of everything that is of one drive (or of one trial of it), and how they are asked for."""
    paths = web.client.get("/openapi.json").json()["paths"]
    return {
        path.format(**ids): "get" if "get" in methods else next(iter(methods))
        for path, methods in paths.items()
        if "{drive_id}" in path and ("{trial_id}" not in path or "trial_id" in ids)
    }


def shown(web: Web) -> str:
    """What is answered by every address that takes no name."""
    paths = web.client.get("/openapi.json").json()["paths"]
    plain = [path for path, methods in paths.items() if "get" in methods and "{" not in path]
    assert len(plain) > 20
    answers = [web.client.get(path) for path in plain if path not in FOLLOWED]
    queries = [entry["name"] for entry in web.client.get("/v1/admin").json()["queries"]]
    answers += [web.client.get(f"/v1/admin/{name}") for name in queries]
    return "\n".join(answer.text for answer in answers)


def test_every_part_is_404_from_the_answer_on_whatever_runs(town_web: Web, drive: str) -> None:
    """No worker has done anything of the removal, and a trial is being computed."""
    client = town_web.client
    trial = client.post(f"/v1/drives/{drive}/trials?method=raw").json()["id"]
    assert client.get(f"/v1/drives/{drive}/profile?f=png").status_code == 200  # it is kept
    run_worker(town_web.settings, wait=False)
    other = client.post(f"/v1/drives/{drive}/trials?method=dem").json()["id"]
    with town_web.sessions.begin() as session:
        session.execute(text("UPDATE drive_trials SET status = 'running' WHERE id = :id"), {"id": other})
    addresses = parts(town_web, drive_id=drive, trial_id=trial)
    assert len(addresses) > 12
    for address, how in addresses.items():
        if how == "get":
            assert client.get(address).status_code == 200, address
    segment = client.get(f"/v1/drives/{drive}/segments").json()["features"][0]["id"]
    assert drive in client.get(f"/v1/segments/{segment}/observations").text
    assert drive in shown(town_web)
    assert client.delete(f"/v1/drives/{drive}").status_code == 202
    for address, how in {**addresses, f"/v1/drives/{drive}/trials": "post"}.items():
        assert check(client.request(how, address), 404)["type"] == "/problems/not-found", address
    assert check(client.delete(f"/v1/drives/{drive}"), 404)
    assert drive not in client.get(f"/v1/segments/{segment}/observations").text
    told = shown(town_web).replace(f'"subject":"{drive}"', "")  # in the audit log
    assert drive not in told and NAME not in told
    for query in ("status=cancelled", "q=mustermann", f"q={drive[:8]}", "sort=filename", "batch=1"):
        assert client.get(f"/v1/drives?{query}").json()["drives"] == [], query
    (waiting,) = [row for row in client.get("/v1/admin/queue").json()["rows"] if "removed" in row["kind"]]
    assert waiting["jobs"] == 1


def test_a_drive_no_longer_names_a_removed_one_as_its_original(filled: Web) -> None:
    original, duplicate = (add_drive(filled.sessions, [0, 1]) for _ in range(2))
    with filled.sessions.begin() as session:
        same = "UPDATE drives SET duplicate_of = :original WHERE id = :id"
        session.execute(text(same), {"original": original, "id": duplicate})
    document = filled.client.get(f"/v1/drives/{duplicate}").json()
    assert document["duplicate_of"] == document["same_as"] == str(original)
    filled.client.delete(f"/v1/drives/{original}")
    assert str(original) not in filled.client.get(f"/v1/drives/{duplicate}").text


def test_many_are_removed_with_the_answer(filled: Web) -> None:
    ids = [add_drive(filled.sessions, [k]) for k in range(3)]
    assert filled.client.post("/v1/drives/remove?which=all").json()["drives"] == 3
    for one in ids:
        check(filled.client.get(f"/v1/drives/{one}"), 404)
    assert filled.client.get("/v1/drives").json()["drives"] == []


def test_a_trial_that_runs_ends_and_leaves_the_lane_to_the_removal(
    town_web: Web, drive: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is computed by the only worker, which takes back the drive next."""
    address = f"/v1/drives/{drive}"
    trial = uuid.UUID(town_web.client.post(f"{address}/trials?method=raw").json()["id"])
    monkeypatch.setattr(machine, "LOOK_EVERY_S", 0.0)
    looks = []

    def removed_meanwhile() -> bool:
        looks.append(1)
        if len(looks) == 2:
            assert town_web.client.delete(address).status_code == 202
        if len(looks) > 3:
            raise Interrupted  # it has gone on with what nobody wants
        return False

    assert machine.perform(TRIAL, town_web.context, trial, Work(removed_meanwhile, nullcontext)) == "unwanted"
    carry_out_removals(town_web.sessions, town_web.blobs)
    with town_web.sessions() as session:
        for table in ("drives", "drive_trials", "drive_tracks"):
            assert session.execute(text(f"SELECT count(*) FROM {table}")).scalar_one() == 0
    assert town_web.blobs.keys() == []


def test_a_removed_drive_takes_its_log_along_before_its_cells_are_solved(town_web: Web, drive: str) -> None:
    town_web.client.delete(f"/v1/drives/{drive}")
    with town_web.sessions() as session:
        generation = session.execute(text("SELECT generation FROM drives")).scalar_one()
    publishing.remove(town_web.sessions, town_web.blobs, uuid.UUID(drive), generation)
    assert town_web.blobs.keys() == []
    with town_web.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM drives")).scalar_one() == 1


def test_messages_of_a_removed_drive_go(filled: Web) -> None:
    drive = add_drive(filled.sessions, [0])
    with filled.sessions.begin() as session:
        session.execute(
            text(
                """
                INSERT INTO webhooks (id, url, secret, events) VALUES (:id, 'https://example.org', 'x', '{drive.done}');
                """
            ),
            {"id": uuid.uuid4()},
        )
        session.execute(
            text(
                "INSERT INTO webhook_deliveries (id, webhook_id, event, data, state) SELECT gen_random_uuid(), id, "
                "'drive.done', CAST(:data AS jsonb), state FROM webhooks, unnest(ARRAY['waiting', 'taken']) AS state"
            ),
            {"data": json.dumps({"drive_id": str(drive)})},
        )
    filled.client.delete(f"/v1/drives/{drive}")
    with filled.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM webhook_deliveries")).scalar_one() == 0


def test_a_removal_waits_longer_for_the_worker_that_writes_than_requests_wait_for_locks(
    settings: Settings, server_maker: Callable[[Settings], AbstractContextManager[Web]]
) -> None:
    def has_waited_long() -> bool:
        with web.sessions() as beside:
            return bool(beside.execute(WAITED_S).scalar_one() > 4 * lock_timeout_s)

    lock_timeout_s = 0.1
    with server_maker(settings.model_copy(update={"lock_timeout_s": lock_timeout_s})) as web:
        sent = web.client.post("/v1/drives", files={"file": (NAME, b"time_s,lat_deg,lon_deg\n1,49,8\n")})
        drive = uuid.UUID(sent.json()["id"])
        with ThreadPoolExecutor(1) as client, web.sessions.begin() as worker:
            assert claims.mark_running(worker, drive, 1)
            answer = client.submit(web.client.delete, f"/v1/drives/{drive}")
            wait_until(has_waited_long)
            assert not answer.done()
            worker.commit()
            assert answer.result().status_code == 202
