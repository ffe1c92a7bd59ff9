"""Trials over HTTP: ask for one, look at it and at what it yielded, remove it. Knows no SQL."""

from __future__ import annotations

import hashlib
import uuid
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import StreamingResponse
from sqlalchemy.orm import Session

from app.core.errors import NotDoneError, NotFoundError
from app.core.http import JSON, BaseUrl, ServiceDep, existing, link, problems
from app.core.http import link_documents as documents
from app.core.messages import say
from app.core.text import GEO_JSON, dumps
from app.drives import store as drives
from app.drives import tracks
from app.drives.method_choice import MethodQuery, asked_positioning, chosen_anew
from app.drives.outputs.measurements import MEASUREMENTS_EXAMPLE, MEASUREMENTS_SCHEMA
from app.drives.outputs.profile_document import PROFILE_EXAMPLE, PROFILE_SCHEMA
from app.drives.parts.reading import (
    CSV,
    ESTIMATES,
    ESTIMATES_CONTENT,
    OVERRIDES,
    PROFILE_CSV,
    EstimatesQuery,
    FindRun,
    PointsQuery,
    RunParts,
    estimates_answer,
    form_of,
    measurements_answer,
    profile_answer,
    profile_of,
    stem_of,
)
from app.drives.trials import store
from app.drives.trials.documents import (
    EXAMPLE_TRIAL_ID,
    Trial,
    TrialAccepted,
    TrialList,
    accepted,
    linked,
    trial_address,
)
from app.drives.trials.store import beside_the_map, decode_slopes, trials
from app.map.segment import attribution
from app.map.store import segments_by_id

PROFILES = {"json": JSON, "csv": CSV}

router = APIRouter(prefix="/v1/drives/{drive_id}/trials", tags=["drives"])

_LOCATION = {"Location": {"description": "The trial.", "schema": {"type": "string", "format": "uri"}}}
_OF_TRIAL = {"trial_id": EXAMPLE_TRIAL_ID}
_MEMBERS = {"trial_id": {"type": "string", "format": "uuid"}}


def _of_trial(schema: dict[str, Any], example: dict[str, Any]) -> dict[str, Any]:
    """The content of an answer that is a drive's, and names the trial as well."""
    properties = {"properties": {**schema["properties"], **_MEMBERS}}
    required = {"required": [*schema["required"], *_MEMBERS]}
    return {"schema": schema | properties | required, "example": example | _OF_TRIAL}


@router.post(
    "",
    status_code=202,
    summary="Try another method on a drive",
    responses={
        200: {"model": TrialAccepted, "description": "Asked for before: that trial.", "headers": _LOCATION},
        202: {"description": "Queued.", "headers": _LOCATION},
        **problems(403, 404, 409, 410, 422, 503),
    },
)
def add_trial(
    drive_id: uuid.UUID, service: ServiceDep, base: BaseUrl, response: Response, query: MethodQuery
) -> TrialAccepted:
    """Compute the drive by another method or with other options, and look at the result beside the drive's own.

    Nothing of it ever reaches the map. What is left out is chosen as for processing again: with neither a method nor
    options the drive's own, with a method alone that method's defaults. It waits behind uploads, goes with its drive,
    and is forgotten a week after its end; a drive has twenty at most (409). The same again answers with the same
    trial, and tries it again if it failed. A drive whose log was deleted is tried no more (410).
    """
    options, positioning = query.asked_options(), asked_positioning(query.gnss, query.gnss_option)
    with service.reading() as session:
        drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
    method = drive.method if query.method == "" else query.method
    chosen = chosen_anew(method, options, positioning, (drive.method, drive.options))
    with service.sessions.begin() as session:
        trial, queued = store.ask(session, drive_id, *chosen, _sha256(*chosen))
    response.status_code = 202 if queued else 200
    response.headers["Location"] = trial_address(base, trial)
    return accepted(base, trial)


@router.get("", summary="Trials of a drive", responses=problems(404, 503))
def list_trials(drive_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> TrialList:
    """All of them, the newest first."""
    with service.reading() as session:
        existing(drives.get_drive(session, drive_id), "drive", drive_id)
        listed = trials.page(session, drive_id=drive_id)
    return TrialList(trials=[linked(base, trial) for trial in listed])


@router.get("/{trial_id}", summary="One trial", responses=problems(404, 503))
def get_trial(drive_id: uuid.UUID, trial_id: uuid.UUID, service: ServiceDep, base: BaseUrl) -> Trial:
    """Status, progress, reason of a failure, and the report once it is done."""
    with service.reading() as session:
        return linked(base, _get_trial(session, drive_id, trial_id))


@router.delete(
    "/{trial_id}", status_code=204, summary="Cancel or remove a trial", responses=problems(403, 404, 503)
)
def delete_trial(drive_id: uuid.UUID, trial_id: uuid.UUID, service: ServiceDep) -> None:
    """Always works, whatever the status, and at once: a worker that computes it discards what it has."""
    with service.sessions.begin() as session:
        if not store.remove(session, drive_id, trial_id):
            existing(None, f"trial of drive {drive_id} called", trial_id)


@router.get(
    "/{trial_id}/profile",
    summary="A trial's elevation profile",
    response_class=Response,
    responses={
        200: {
            "description": "Columns over the distance driven, as of the drive.",
            "content": {
                JSON: _of_trial(PROFILE_SCHEMA, PROFILE_EXAMPLE),
                CSV: PROFILE_CSV,
            },
        },
        **problems(404, 406, 409, 422, 503),
    },
)
async def trial_profile(
    drive_id: uuid.UUID,
    trial_id: uuid.UUID,
    request: Request,
    service: ServiceDep,
    f: Annotated[Literal["json", "csv"] | None, Query(description=OVERRIDES)] = None,
    points: PointsQuery = None,
) -> Response:
    """As `/v1/drives/{drive_id}/profile`, with the trial's heights, grades and slopes. 409 until it is done."""
    form = form_of(f, request.headers.get("accept"), PROFILES)
    return await profile_answer(service, _run_of(drive_id, trial_id), form, points)


@router.get(
    "/{trial_id}/measurements",
    summary="What the sensors said, as a trial took them",
    response_class=Response,
    responses={
        200: {
            "description": "Columns over the distance driven, of each sensor.",
            "content": {JSON: _of_trial(MEASUREMENTS_SCHEMA, MEASUREMENTS_EXAMPLE)},
        },
        **problems(404, 409, 422, 503),
    },
)
async def trial_measurements(
    drive_id: uuid.UUID, trial_id: uuid.UUID, service: ServiceDep, points: PointsQuery = None
) -> Response:
    """As `/v1/drives/{drive_id}/measurements`: what is taken off each depends on the method. 409 until it is done."""
    return await measurements_answer(service, _run_of(drive_id, trial_id), points)


@router.get(
    "/{trial_id}/segments",
    summary="A trial's estimates",
    response_class=StreamingResponse,
    responses={
        200: {
            "description": "All of them, in the order of driving.",
            "content": ESTIMATES_CONTENT,
        },
        **problems(404, 406, 409, 422, 503),
    },
)
def trial_segments(
    drive_id: uuid.UUID,
    trial_id: uuid.UUID,
    request: Request,
    service: ServiceDep,
    base: BaseUrl,
    f: Annotated[EstimatesQuery, Query(description=OVERRIDES)] = None,
) -> StreamingResponse:
    """As `/v1/drives/{drive_id}/segments`: slope and sigma of each segment from the trial alone. 409 until it is done.

    `in_network` is false and `accepted` null, for no trial is part of the network. A segment that was dropped from the
    map since is left out.
    """
    form = form_of(f, request.headers.get("accept"), ESTIMATES)
    with service.reading() as session:
        trial, result, stem = _done(session, drive_id, trial_id)
        slopes = decode_slopes(result.slopes)
        rows = beside_the_map(slopes, segments_by_id(session, [slope.segment for slope in slopes]))
    links = documents([link(f"{trial_address(base, trial)}/segments", "self", GEO_JSON)])
    members = {"attribution": attribution(), "numberReturned": len(rows), "links": links}
    return estimates_answer(form, rows, members, stem)


def _run_of(drive_id: uuid.UUID, trial_id: uuid.UUID) -> FindRun:
    """Finds the trial, once it is done."""

    def find(session: Session) -> RunParts:
        trial, result, stem = _done(session, drive_id, trial_id)
        slopes = {
            slope.segment: (slope.slope_percent, slope.slope_sigma_percent)
            for slope in decode_slopes(result.slopes)
        }
        return RunParts(
            {"drive_id": str(drive_id), "trial_id": str(trial.id)},
            stem,
            lambda: profile_of(session, tracks.decode(result.track), slopes),
            lambda: None if result.measurements is None else tracks.decode_measurements(result.measurements),
        )

    return find


def _get_trial(session: Session, drive_id: uuid.UUID, trial_id: uuid.UUID) -> Trial:
    return existing(
        trials.get(session, trial_id, drive_id=drive_id), f"trial of drive {drive_id} called", trial_id
    )


def _done(session: Session, drive_id: uuid.UUID, trial_id: uuid.UUID) -> tuple[Trial, store.Result, str]:
    """The trial, what it yielded, and what names of its files begin with; ``NotDoneError`` and ``NotFoundError`` say
    why there is nothing."""
    trial = _get_trial(session, drive_id, trial_id)
    if (result := store.result_of(session, trial)) is not None:
        drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
        return trial, result, f"{stem_of(drive.filename)}-{trial.method}"
    if trial.failure is not None:
        raise NotFoundError(say("trial.failed", id=trial_id, reason=trial.failure.reason))
    raise NotDoneError(say("trial.not_done", id=trial_id, status=trial.status, share=trial.progress))


def _sha256(method: str, options: Mapping[str, Any]) -> str:
    """Names the method with what its options change: written out or left to their defaults they are the same."""
    changed = dict(options)
    if changed:
        from fusion.pipeline import parse_options  # noqa: PLC0415 - loads the methods, see check_options

        plain = parse_options(method, {}).model_dump(mode="json")
        complete = parse_options(method, changed).model_dump(mode="json")
        changed = {
            name: value for name, value in complete.items() if name not in plain or value != plain[name]
        }
    text = dumps([method, {name: changed[name] for name in sorted(changed)}])
    return hashlib.sha256(text.encode()).hexdigest()
