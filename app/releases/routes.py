"""Editions over HTTP: what there is, and their files, whole or in parts; and what the service shows to whom.

Knows no SQL.
"""

from __future__ import annotations

from typing import Annotated, Any, BinaryIO, Literal

from fastapi import APIRouter, Path, Request, Response

from app.core.errors import BadRequestError, NotFoundError
from app.core.http import REVALIDATE, BaseUrl, Service, ServiceDep, existing, link, problems
from app.core.messages import say
from app.core.query import refuse_unknown
from app.exports.ranges import Stored, stored_answer
from app.releases import documents, keeping, store
from app.releases.privacy import Privacy, privacy_of
from app.releases.store import Edition

router = APIRouter(tags=["editions"])

Number = Annotated[
    Annotated[int, Path(ge=1, le=2**31 - 1)] | Literal["latest"],
    Path(description="Of the edition; `latest` stands for the newest."),
]
_BYTES: dict[str, Any] = {
    "content": {
        "application/octet-stream": {
            "schema": {"type": "string", "format": "binary"},
            "example": "(the bytes of slopes.pmtiles)",
        }
    }
}


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
        200: {"description": "The file.", **_BYTES},
        206: {"description": "The part of it that `Range` asks for.", **_BYTES},
        304: {"description": "Unchanged since the ETag."},
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
