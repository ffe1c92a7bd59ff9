"""Trials through HTTP and a worker: a look at another method, and not one row of the map."""

from __future__ import annotations

import csv
import io
import json
import random
import uuid
from typing import Any

from jsonschema import Draft202012Validator
from sqlalchemy import text

from app.drives.outputs.profile_document import PROFILE_SCHEMA
from app.drives.worker import run_worker
from fusion.pipeline import parse_options
from problem_support import check
from processing_support import carry_out_removals
from web_fixtures import Web

BESIDE = {"drive_trials", "alembic_version", "spatial_ref_sys", "computations"}
"""Tables that are no part of what the service knows: trials themselves, and bookkeeping."""


def work(web: Web) -> None:
    run_worker(web.settings, wait=False, with_chores=False)


def everything(web: Web) -> dict[str, list[str]]:
    """Every row of every table but those of trials, of the queue and of what is counted."""
    tables = text(
        "SELECT relname FROM pg_class WHERE relkind = 'r' AND relnamespace = 'public'::regnamespace"
        " AND relname NOT LIKE 'procrastinate%' AND relname NOT LIKE '%totals%' ORDER BY relname"
    )
    with web.sessions() as session:
        names = [name for name in session.execute(tables).scalars() if name not in BESIDE]
        return {
            name: sorted(session.execute(text(f"SELECT CAST(t AS text) FROM {name} AS t")).scalars())
            for name in names
        }


def asked(web: Web, drive: str, query: str = "", status: int = 202) -> dict[str, Any]:
    answer = web.client.post(f"{drive}/trials{query}")
    assert answer.status_code == status, answer.text
    document: dict[str, Any] = answer.json()
    assert set(document) == {"id", "drive_id", "status", "links"}
    assert answer.headers["location"].endswith(f"{drive}/trials/{document['id']}")
    return document


def trial_of(web: Web, drive: str, trial: dict[str, Any]) -> dict[str, Any]:
    answer = web.client.get(f"{drive}/trials/{trial['id']}")
    assert answer.status_code == 200, answer.text
    document: dict[str, Any] = answer.json()
    return document


def test_a_trial_shows_another_method_and_changes_nothing(town_web: Web, driven: str) -> None:
    work(town_web)  # what follows from the drive itself
    client, before = town_web.client, everything(town_web)
    assert {"drives", "drive_segments", "segment_slopes", "network_slopes", "network_marks", "cells"} <= set(
        before
    )
    trial = asked(town_web, driven, "?method=profile")
    here = f"{driven}/trials/{trial['id']}"
    assert trial_of(town_web, driven, trial)["status"] == "queued"
    for part in ("profile", "segments", "measurements"):
        assert "queued" in check(client.get(f"{here}/{part}"), 409)["detail"]
    work(town_web)

    document = trial_of(town_web, driven, trial)
    assert (document["status"], document["progress"], document["failure"]) == ("done", 1.0, None)
    assert document["report"]["segments_estimated"] > 5
    assert {"code_version", "road_version", "dem_version", "warnings"} <= set(document["report"])
    assert document["expires_at"][:4] >= document["finished_at"][:4]
    assert {one["rel"] for one in document["links"]} == {"self", "up", "profile", "measurements", "segments"}
    assert client.get(f"{driven}/trials").json() == {"trials": [document]}

    profile, own = client.get(f"{here}/profile").json(), client.get(f"{driven}/profile").json()
    Draft202012Validator(PROFILE_SCHEMA).validate(profile)
    assert set(profile) == set(own) | {"trial_id"}
    assert any(grade is not None for grade in profile["grade_percent"])
    assert any(height is not None for height in profile["dem_height_m"])
    few = client.get(f"{here}/profile?points=20").json()
    assert few["epochs"] <= 20
    assert max(filter(None, few["grade_percent"])) == max(filter(None, profile["grade_percent"]))
    assert client.get(f"{here}/profile?f=csv").text.startswith("distance_m,")
    sensors = client.get(f"{here}/measurements?points=50").json()["sensors"]
    assert {"altitude", "doppler"} <= {sensor["name"] for sensor in sensors}

    estimates = client.get(f"{here}/segments").json()
    assert len(estimates["features"]) == estimates["numberReturned"] > 5
    first = estimates["features"][0]["properties"]
    assert (first["in_network"], first["accepted"]) == (False, None)
    assert {"combined_slope_percent", "combined_drives", "slope_sigma_percent"} <= set(first)
    rows = list(csv.DictReader(io.StringIO(client.get(f"{here}/segments?f=csv").text)))
    assert [int(row["id"]) for row in rows] == [feature["id"] for feature in estimates["features"]]
    assert everything(town_web) == before


def test_the_drive_s_own_method_says_what_the_drive_says(town_web: Web, driven: str) -> None:
    trial = asked(town_web, driven)
    work(town_web)
    here = f"{driven}/trials/{trial['id']}"
    same = ("slope_percent", "slope_sigma_percent", "observations", "passes", "first_at", "last_at")

    def said(address: str) -> dict[int, list[Any]]:
        features = town_web.client.get(f"{address}/segments?f=geojson").json()["features"]
        return {one["id"]: [one["properties"][name] for name in same] for one in features}

    assert said(here) == said(driven)
    profile = town_web.client.get(f"{here}/profile").json()
    assert profile.pop("trial_id") == trial["id"]
    assert profile == town_web.client.get(f"{driven}/profile").json()


def test_the_same_again_is_the_same_trial(filled: Web, uploaded: str) -> None:
    first = asked(filled, uploaded, "?method=particle&option=particles:1000&option=variant:ch2")
    plain = parse_options("particle", {})
    again = [
        "?method=particle&option=variant:ch2&option=particles:1000",
        f'?method=particle&options={{"particles":1000,"variant":"ch2","gnss":"{plain.gnss}"}}',
    ]
    assert {asked(filled, uploaded, query, 200)["id"] for query in again} == {first["id"]}
    assert asked(filled, uploaded, "?method=particle&option=particles:2000")["id"] != first["id"]
    assert len(filled.client.get(f"{uploaded}/trials").json()["trials"]) == 2


def test_a_drive_has_twenty_at_most(filled: Web, uploaded: str) -> None:
    many = [asked(filled, uploaded, f"?method=particle&option=particles:{100 + k}") for k in range(20)]
    problem = check(filled.client.post(f"{uploaded}/trials?method=dem"), 409)
    assert problem["type"] == "/problems/too-many"
    assert "20 trials already" in problem["detail"]
    asked(filled, uploaded, "?method=particle&option=particles:100", 200)
    assert filled.client.delete(f"{uploaded}/trials/{many[3]['id']}").status_code == 204
    asked(filled, uploaded, "?method=dem")


def test_trials_that_cannot_be(filled: Web, uploaded: str) -> None:
    for query, type_ in {
        "?method=magic": "unknown-name",
        "?method=particle&option=particles:-1": "bad-options",
        "?method=particle&options=[1]": "invalid-request",
        "?gnss=magic": "unknown-name",
        "?option=x": "invalid-request",
    }.items():
        problem = check(filled.client.post(f"{uploaded}/trials{query}"), 422)
        assert problem["type"] == f"/problems/{type_}", query
    assert filled.client.get(f"{uploaded}/trials").json() == {"trials": []}


def test_no_options_are_a_fault_of_the_service(filled: Web, uploaded: str) -> None:
    draw = random.Random(0)  # noqa: S311 - any will do
    values = [None, True, -1, 0, 1, 1e300, "", "x", "\x00", [], {}, {"a": [1]}, "receiver", "ls"]
    names = ["particles", "variant", "gnss", "gnss_options", "columns", "dem_window", "x", ""]
    for _ in range(60):
        options = {draw.choice(names): draw.choice(values) for _ in range(draw.randrange(4))}
        query = {"method": draw.choice(["particle", "raw", "profile", "dem", "", "x"])}
        answer = filled.client.post(f"{uploaded}/trials", params=query | {"options": json.dumps(options)})
        assert answer.status_code in {200, 202, 409, 422}, (options, answer.text)


def test_trials_of_nothing(filled: Web, uploaded: str) -> None:
    client, nobody = filled.client, uuid.uuid4()
    for part in ("", "/profile", "/segments", "/measurements"):
        check(client.get(f"{uploaded}/trials/{nobody}{part}"), 404)
    check(client.delete(f"{uploaded}/trials/{nobody}"), 404)
    check(client.get(f"/v1/drives/{nobody}/trials"), 404)
    check(client.post(f"/v1/drives/{nobody}/trials?method=raw"), 404)
    trial = asked(filled, uploaded)
    check(client.get(f"/v1/drives/{nobody}/trials/{trial['id']}"), 404)
    check(client.delete(f"/v1/drives/{nobody}/trials/{trial['id']}"), 404)


def test_trials_go_with_their_drive(filled: Web, uploaded: str) -> None:
    done = asked(filled, uploaded)
    work(filled)
    waiting = asked(filled, uploaded, "?method=dem")
    assert filled.client.delete(uploaded).status_code == 202
    check(filled.client.post(f"{uploaded}/trials?method=profile"), 404)
    carry_out_removals(filled.sessions, filled.blobs)
    for trial in (done, waiting):
        check(filled.client.get(f"{uploaded}/trials/{trial['id']}"), 404)
    work(filled)
    with filled.sessions() as session:
        assert session.execute(text("SELECT count(*) FROM drive_trials")).scalar_one() == 0
        assert session.execute(text("SELECT count(*) FROM procrastinate_jobs")).scalar_one() == 0


def test_one_that_failed_says_why_and_is_tried_again(filled: Web) -> None:
    """Nobody has roads there."""
    rows = [f"{1_700_000_000 + k},{12 + 9e-5 * k:.7f},8.4,120" for k in range(60)]
    log = "\n".join(["time_s,lat_deg,lon_deg,alt_msl_m", *rows]).encode()
    drive = f"/v1/drives/{filled.client.post('/v1/drives?method=raw', content=log).json()['id']}"
    trial = asked(filled, drive)
    work(filled)
    failed = trial_of(filled, drive, trial)
    assert (failed["status"], failed["failure"]["kind"]) == ("failed", "no-match")
    assert failed["report"] is None
    problem = check(filled.client.get(f"{drive}/trials/{trial['id']}/profile"), 404)
    assert failed["failure"]["reason"] in problem["detail"]
    assert asked(filled, drive)["id"] == trial["id"]
    again = trial_of(filled, drive, trial)
    assert (again["status"], again["failure"], again["finished_at"]) == ("queued", None, None)
