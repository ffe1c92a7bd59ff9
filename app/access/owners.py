"""Owners over HTTP: what each has, and what it may upload."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Body, Path
from sqlalchemy.orm import Session

from app.access import store
from app.access.documents import NewOwner, Owner, OwnerChange, OwnerFigures, Owners
from app.access.quotas import OwnQuotas, set_quotas, standing, utc_now
from app.core.caller import present_caller
from app.core.http import UNREADABLE_BODY, Service, ServiceDep, existing, problems
from app.core.telemetry import audit
from app.core.telemetry.audit import Origin

router = APIRouter(prefix="/v1", tags=["access"])

MAX_ID = 2**63 - 1
OwnerId = Annotated[int, Path(ge=1, le=MAX_ID, description="The owner's number.", examples=[2])]


@router.get("/owners", summary="The owners", response_model=Owners, responses=problems(401, 403))
def list_owners(service: ServiceDep) -> Owners:
    """Every owner with the number of its keys and drives."""
    with service.reading() as session:
        return Owners(owners=[Owner.of(one) for one in store.owners(session)])


@router.post(
    "/owners",
    status_code=201,
    summary="Make an owner",
    response_model=Owner,
    responses={**UNREADABLE_BODY, **problems(401, 403, 409, 422)},
)
def make_owner(request: NewOwner, service: ServiceDep, origin: Origin) -> Owner:
    """Make an owner, who has no key yet."""
    with service.sessions.begin() as session:
        owner = store.create_owner(session, request.name)
        audit.note(session, origin, "owner made", f"owner {owner.id}")
    return Owner.of(owner)


@router.get("/owner", summary="The caller's owner", response_model=OwnerFigures, responses=problems(401, 403))
def own_figures(service: ServiceDep) -> OwnerFigures:
    """What the caller's owner has, what it uploaded today, and what it may."""
    owner_id = present_caller().owner_id
    assert owner_id is not None  # noqa: S101 - whoever may do this has an owner
    with service.reading() as session:
        return _figures(session, service, owner_id)


@router.get(
    "/owners/{owner_id}",
    summary="One owner",
    response_model=OwnerFigures,
    responses=problems(401, 403, 404),
)
def get_owner(owner_id: OwnerId, service: ServiceDep) -> OwnerFigures:
    """What the owner has, what it uploaded today, and what it may."""
    with service.reading() as session:
        return _figures(session, service, owner_id)


@router.patch(
    "/owners/{owner_id}",
    summary="Change an owner's quotas",
    response_model=OwnerFigures,
    responses={**UNREADABLE_BODY, **problems(401, 403, 404, 422)},
)
def change_owner(
    owner_id: OwnerId,
    service: ServiceDep,
    origin: Origin,
    body: Annotated[OwnerChange | None, Body()] = None,
) -> OwnerFigures:
    """Give an owner quotas of its own, or with null those of all again; from the next upload on."""
    wish = (body or OwnerChange()).model_dump(exclude_unset=True)
    changes = {name.removeprefix("quota_"): most for name, most in wish.items()}
    with service.sessions.begin() as session:
        before = _figures(session, service, owner_id)
        own = OwnQuotas(before.quota_drives, before.quota_bytes)._replace(**changes)
        set_quotas(session, owner_id, own)
        audit.note(session, origin, "quotas changed", f"owner {owner_id}", **own._asdict())
        return _figures(session, service, owner_id)


def _figures(session: Session, service: Service, owner_id: int) -> OwnerFigures:
    owner: store.Owner = existing(store.get_owner(session, owner_id), "owner", owner_id)
    return OwnerFigures.standing(owner, standing(session, service.settings, owner_id, utc_now()))
