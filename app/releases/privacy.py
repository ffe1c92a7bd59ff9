"""What the service shows to whom, as a document: in plain words, and as figures for programs."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, Field

from app.core.http import Link, link
from app.core.settings import Settings
from app.core.settings.access import PublicMap
from app.releases import ends
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
