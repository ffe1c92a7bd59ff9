"""Keys and owners over HTTP."""

from __future__ import annotations

import uuid
from datetime import UTC, datetime
from typing import Annotated

from fastapi import APIRouter, Body, Path, Query, Request, Response
from sqlalchemy.orm import Session

from app.access import store
from app.access.documents import (
    KeepingChange,
    Key,
    Keys,
    MadeKey,
    NewKey,
    NewOwner,
    Owner,
    OwnerChange,
    OwnerFigures,
    Owners,
)
from app.access.gate import callers_of
from app.access.quotas import KINDS, OwnQuotas, set_quotas, standing, utc_now
from app.core.caller import present_caller
from app.core.errors import BadRequestError, ForbiddenError, TooManyError
from app.core.http import UNREADABLE_BODY, Service, ServiceDep, existing, problems
from app.core.messages import say
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin

router = APIRouter(prefix="/v1", tags=["access"])

MOST_KEYS = 10_000
"""Of one owner, those included that are revoked: they stay, for the audit names them."""
MAX_ID = 2**63 - 1
OwnerId = Annotated[int, Path(ge=1, le=MAX_ID, description="The owner's number.", examples=[2])]


@router.get("/keys", summary="The keys", responses=problems(401, 403, 404))
def list_keys(
    service: ServiceDep,
    owner: Annotated[str | None, Query(description="Only those of the owner of that name.")] = None,
) -> Keys:
    """The keys of the caller's owner; with the scope `operate` those of all."""
    with service.reading() as session:
        owner_id = None if owner is None else existing(store.owner_named(session, owner), "owner", owner).id
        return Keys(keys=[Key.of(key) for key in store.list_keys(session, owner_id)])


@router.post(
    "/keys",
    status_code=201,
    summary="Make a key",
    responses={**UNREADABLE_BODY, **problems(401, 403, 404, 409, 422)},
)
def make_key(request: NewKey, response: Response, service: ServiceDep, origin: Origin) -> MadeKey:
    """Make a key. Its secret is in the answer and is never told again."""
    caller = present_caller()
    if not caller.may(request.scope):
        raise ForbiddenError(say("access.more_than_itself"))
    if request.expires_at is not None and request.expires_at <= datetime.now(UTC):
        raise BadRequestError.about("expires_at", say("access.past"))
    response.headers["Cache-Control"] = "no-store"
    with service.sessions.begin() as session:
        owner_id = store.own_id()
        if request.owner is not None:
            owner_id = existing(store.owner_named(session, request.owner), "owner", request.owner).id
        if len(store.list_keys(session, owner_id)) >= MOST_KEYS:
            raise TooManyError(say("access.many_keys", most=MOST_KEYS))
        key, secret = store.create_key(session, owner_id, request.label, request.scope, request.expires_at)
        audit.note(session, origin, "key made", f"key {key.id}", scope=key.scope, owner=key.owner)
    return MadeKey(key=Key.of(key), secret=secret)


@router.delete("/keys/{key_id}", status_code=204, summary="Revoke a key", responses=problems(401, 403, 404))
def revoke_key(key_id: uuid.UUID, request: Request, service: ServiceDep, origin: Origin) -> Response:
    """From the answer on the key lets nobody in, nor does a session that began with it."""
    with service.sessions.begin() as session:
        _own_key(session, key_id)
        store.revoke_key(session, key_id)
        audit.note(session, origin, "key revoked", f"key {key_id}")
    callers_of(request.scope).forget()
    return Response(status_code=204)


@router.post(
    "/keys/{key_id}/rotate",
    summary="Give a key another secret",
    responses=problems(401, 403, 404),
)
def rotate_key(
    key_id: uuid.UUID, request: Request, response: Response, service: ServiceDep, origin: Origin
) -> MadeKey:
    """The secret before is void from the answer on, and so are the key's sessions."""
    response.headers["Cache-Control"] = "no-store"
    with service.sessions.begin() as session:
        _own_key(session, key_id)
        made = existing(store.rotate_key(session, key_id), "key that is not revoked", key_id)
        audit.note(session, origin, "key rotated", f"key {key_id}")
    callers_of(request.scope).forget()
    key, secret = made
    return MadeKey(key=Key.of(key), secret=secret)


def _own_key(session: Session, key_id: uuid.UUID) -> None:
    """Raise unless the caller may change that key: one of its owner's that may do no more than itself."""
    key = existing(store.get_key(session, key_id), "key", key_id)
    if not present_caller().may(key.scope):
        raise ForbiddenError(say("access.that_may_more"))


@router.get("/owners", summary="The owners", responses=problems(401, 403))
def list_owners(service: ServiceDep) -> Owners:
    """Every owner with the number of its keys and drives."""
    with service.reading() as session:
        return Owners(owners=[Owner.of(one) for one in store.owners(session)])


@router.post(
    "/owners",
    status_code=201,
    summary="Make an owner",
    responses={**UNREADABLE_BODY, **problems(401, 403, 409, 422)},
)
def make_owner(request: NewOwner, service: ServiceDep, origin: Origin) -> Owner:
    """Make an owner, who has no key yet."""
    with service.sessions.begin() as session:
        owner = store.create_owner(session, request.name)
        audit.note(session, origin, "owner made", f"owner {owner.id}")
    return Owner.of(owner)


@router.get("/owner", summary="The caller's owner", responses=problems(401, 403))
def own_figures(service: ServiceDep) -> OwnerFigures:
    """What the caller's owner has, what it uploaded today, and what it may."""
    with service.reading() as session:
        return _figures(session, service, store.own_id())


@router.patch(
    "/owner",
    summary="Change for how long one's logs are kept",
    responses={**UNREADABLE_BODY, **problems(401, 403, 422)},
)
def change_own(
    service: ServiceDep, origin: Origin, body: Annotated[KeepingChange | None, Body()] = None
) -> OwnerFigures:
    """Logs that are older than that by now are deleted within minutes; what is deleted does not come back."""
    return _change(service, origin, store.own_id(), body or KeepingChange())


@router.get(
    "/owners/{owner_id}",
    summary="One owner",
    responses=problems(401, 403, 404),
)
def get_owner(owner_id: OwnerId, service: ServiceDep) -> OwnerFigures:
    """What the owner has, what it uploaded today, and what it may."""
    with service.reading() as session:
        return _figures(session, service, owner_id)


@router.patch(
    "/owners/{owner_id}",
    summary="Change an owner's quotas, and for how long its logs are kept",
    responses={**UNREADABLE_BODY, **problems(401, 403, 404, 422)},
)
def change_owner(
    owner_id: OwnerId,
    service: ServiceDep,
    origin: Origin,
    body: Annotated[OwnerChange | None, Body()] = None,
) -> OwnerFigures:
    """Give an owner what is its own, or with null what holds for all again: quotas from the next upload on."""
    return _change(service, origin, owner_id, body or OwnerChange())


def _change(service: Service, origin: str, owner_id: int, change: KeepingChange) -> OwnerFigures:
    wish = change.model_dump(exclude_unset=True)
    quotas = {name.removeprefix("quota_"): most for name, most in wish.items() if name.startswith("quota_")}
    subject = f"owner {owner_id}"
    with service.sessions.begin() as session:
        before = _figures(session, service, owner_id)
        if quotas:
            own = OwnQuotas._make(getattr(before, f"quota_{kind}") for kind in KINDS)._replace(**quotas)
            set_quotas(session, owner_id, own)
            audit.note(session, origin, "quotas changed", subject, **own._asdict())
        if "keep_logs_days" in wish:
            store.set_keep_logs(session, owner_id, wish["keep_logs_days"])
            audit.note(session, origin, "keeping of logs changed", subject, days=wish["keep_logs_days"])
        return _figures(session, service, owner_id)


def _figures(session: Session, service: Service, owner_id: int) -> OwnerFigures:
    owner = existing(store.get_owner(session, owner_id), "owner", owner_id)
    now = standing(session, service.settings, owner_id, utc_now())
    return OwnerFigures.standing(owner, now, service.settings.keep_logs_days)
