"""Editions over HTTP: what there is, and their files, whole or in parts; and what the service shows to whom.

Knows no SQL.
"""

from __future__ import annotations

from typing import Annotated, Any, BinaryIO, Literal

from fastapi import APIRouter, Path, Request, Response
from pydantic import BaseModel, Field

from app.core.errors import BadRequestError, NotFoundError
from app.core.http import (
    REVALIDATE,
    BaseUrl,
    Link,
    Service,
    ServiceDep,
    existing,
    file_answers,
    link,
    problems,
)
from app.core.messages import say
from app.core.query import refuse_unknown
from app.core.settings import Settings
from app.core.settings.access import PublicMap
from app.exports.ranges import Stored, stored_answer
from app.releases import documents, ends, keeping, store
from app.releases.documents import EXAMPLE_FIGURES, Figures
from app.releases.store import Edition

Who = Literal["nobody", "live", "upload", "own", "operate"]

_LIVE, _EDITION = "the map as it is at this moment", "the newest edition of the map"
_EXAMPLE: dict[str, Any] = {
    "access": "keys",
    "public_map": "releases",
    "owners_map": "live",
    "owners": 3,
    "owners_needed": 5,
    "days_between_editions": 7,
    "trip_ends_m": [150, 400],
    "stops_over_s": 120,
    "edition": EXAMPLE_FIGURES,
    "seen": [{"by": "nobody", "text": "The newest edition of the map."}],
    "text": ["A drive that is removed is in no edition that is made after that."],
    "links": [],
}


class Seen(BaseModel):
    """What somebody sees."""

    by: Who = Field(description="`nobody`: without a key; else the scope of a key.")
    text: str


class Privacy(BaseModel, json_schema_extra={"examples": [_EXAMPLE]}):
    """What of drives is seen by whom. Figures that only editions have are null where none are made."""

    access: Literal["keys", "open"] = Field(description="`open`: everybody is answered as an operator is.")
    public_map: PublicMap = Field(description="What of the map is seen without a key.")
    owners_map: Literal["live", "releases"] = Field(description="What of the map a key of scope `own` sees.")
    owners: int | None = Field(description="k: each owner is hidden among so many.")
    owners_needed: int | None = Field(
        description="So many distinct owners drove each segment of the next edition: k, and those who might work "
        "together."
    )
    days_between_editions: int | None
    trip_ends_m: tuple[int, int] | None = Field(
        description="The ends of trips, and long stops, are in no edition within a distance between these, metres; "
        "which it is for a place of an owner, nobody is told."
    )
    stops_over_s: int | None = Field(description="A stop is long that lasts longer, seconds.")
    edition: Figures | None = Field(description="The newest edition.")
    seen: list[Seen] = Field(description="By whoever has no key, then by keys of each scope.")
    text: list[str] = Field(description="The rest, in sentences.")
    links: list[Link]


def privacy_of(settings: Settings, edition: Edition | None, base: str) -> Privacy:
    """What a service with these settings shows to whom; ``edition``: its newest."""
    released = settings.shown_map == "releases"
    links = [link(f"{base}/v1/privacy", "self")]
    links += [link(f"{base}/v1/editions", "related", title="Editions of the map")] if released else []
    return Privacy(
        access=settings.access,
        public_map=settings.shown_map,
        owners_map="releases" if settings.owners_see_editions else "live",
        owners=settings.public_owners if released else None,
        owners_needed=settings.owners_needed if released else None,
        days_between_editions=settings.release_days if released else None,
        trip_ends_m=(round(ends.NEAREST_M), round(ends.FARTHEST_M)) if released else None,
        stops_over_s=round(ends.STOP_S) if released else None,
        edition=None if edition is None or not released else Figures.of(edition),
        seen=_seen(settings),
        text=_of_editions(settings) if released else [],
        links=links,
    )


def _seen(settings: Settings) -> list[Seen]:
    if settings.access == "open":
        return [Seen(by="nobody", text="Everything. The service asks for no keys.")]
    without_key = {
        "live": f"{_LIVE.capitalize()}. It changes when a drive arrives, and so shows where that drive was.",
        "off": "Nothing of the map and nothing of drives.",
        "releases": f"{_EDITION.capitalize()}, and nothing of drives.",
    }[settings.shown_map]
    owners = _EDITION if settings.owners_see_editions else _LIVE
    return [
        Seen(by="nobody", text=without_key),
        Seen(by="live", text="The last point of its own devices, beside what is seen without a key."),
        Seen(
            by="upload", text="The state of the drives that the key sent, beside what is seen without a key."
        ),
        Seen(by="own", text=f"All of its owner's drives, with logs, tracks and profiles; {owners}."),
        Seen(by="operate", text=f"The drives of all owners; {_LIVE}."),
    ]


def _of_editions(settings: Settings) -> list[str]:
    return [
        f"An edition is made every {settings.release_days} days, and is computed from what may be told alone.",
        _hidden(settings.public_owners, settings.owners_needed),
        "It counts drives in steps, and tells no time but its day.",
        f"The ends of trips, and stops of more than {ends.STOP_S / 60:.0f} minutes, are in no edition, as far as "
        f"{ends.NEAREST_M:.0f} to {ends.FARTHEST_M:.0f} m around; owners can name further places.",
        "A drive that is removed is in no edition that is made after that. Whoever kept an earlier one still has it.",
    ]


def _hidden(k: int, needed: int) -> str:
    if needed == 1:
        return "It shows the slope of every segment that anybody drove: it hides nobody."
    others = f" even if {needed - k} of them tell each other everything" if needed > k else ""
    return (
        f"It shows the slope of a segment that at least {needed} owners drove, so that each is hidden among "
        f"{k}{others}. The slope changes only where so many owners contribute to the change; until then drives wait."
    )


router = APIRouter(tags=["editions"])

Number = Annotated[
    Annotated[int, Path(ge=1, le=2**31 - 1)] | Literal["latest"],
    Path(description="Of the edition; `latest` stands for the newest."),
]


@router.get("/v1/editions", summary="Editions of the public map", responses=problems(422, 503))
def list_editions(request: Request, service: ServiceDep, base: BaseUrl) -> documents.EditionList:
    """All of them, the newest first; those of older ones that are kept no longer have no files."""
    refuse_unknown(request, (), BadRequestError)
    with service.reading() as session:
        editions = store.list_editions(session)
    shown = [documents.EditionDocument.linked(base, one) for one in editions]
    return documents.EditionList(editions=shown, links=[link(f"{base}/v1/editions", "self")])


@router.get("/v1/editions/{number}", summary="One edition", responses=problems(404, 503))
def get_edition(number: Number, service: ServiceDep, base: BaseUrl) -> documents.EditionDocument:
    """Its day, how many owners it hides each among, what it holds and withholds, and its files."""
    return documents.EditionDocument.linked(base, _edition(service, number))


@router.get(
    "/v1/editions/{number}/{name}",
    summary="A file of an edition",
    response_class=Response,
    responses={
        **file_answers("(the bytes of slopes.pmtiles)"),
        **problems(404, 416, 503),
    },
)
def get_file(number: Number, name: str, request: Request, service: ServiceDep) -> Response:
    """The bytes as they were made, resumable: `Range` with `If-Range`. The ETag is the SHA-256 of the whole file.

    `manifest.json` names the others with their checksums. `latest` is the newest edition whose files are written;
    `Content-Location` says which one that is.
    """
    edition = _edition(service, number, with_files=True)
    named = next((file for file in edition.files if file["name"] == name), None)
    file = existing(named, f"file of edition {edition.number} called", name[:80])
    stored = Stored(file["sha256"], int(file["size_bytes"]), file["media_type"])

    def opened() -> BinaryIO:
        try:
            return keeping.open_file(service.settings, edition, name)
        except FileNotFoundError:
            raise NotFoundError(say("release.files_gone", n=edition.number)) from None

    here = f"/v1/editions/{edition.number}/{name}"
    return stored_answer(request, stored, opened, {"Cache-Control": REVALIDATE, "Content-Location": here})


@router.get("/v1/privacy", summary="What the service shows to whom", responses=problems(503))
def get_privacy(service: ServiceDep, base: BaseUrl) -> Privacy:
    """What of a drive is seen by whom: in words, and as figures for programs."""
    with service.reading() as session:
        return privacy_of(service.settings, store.latest_edition(session), base)


def _edition(service: Service, number: int | Literal["latest"], *, with_files: bool = False) -> Edition:
    """``with_files``: the newest is the newest that has any."""
    with service.reading() as session:
        if number == documents.LATEST:
            known = (one for one in store.list_editions(session) if one.files or not with_files)
            edition = next(known, None)
        else:
            edition = store.get_edition(session, int(number))
    return existing(edition, "edition", number)
