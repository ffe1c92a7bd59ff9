"""What every program that sends points has in common: a message, how it is read, and how its address is typed."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import parse_qsl

from app.core.errors import BadRequestError
from app.core.messages import say
from app.drives.live.points import Batch


@dataclass(frozen=True)
class Message:
    """A request of a program; names of headers are in small letters."""

    query: Mapping[str, str] = field(default_factory=dict)
    body: bytes = b""
    headers: Mapping[str, str] = field(default_factory=dict)

    def json(self) -> Any:
        """The body; None: it is empty. ``BadRequestError`` where it is no JSON, or was cut off."""
        if not self.body.strip():
            return None
        try:
            return json.loads(self.body)
        except (ValueError, RecursionError):
            raise BadRequestError(say("live.no_json"), field="body") from None

    def fields(self) -> Mapping[str, Any]:
        """What the address and the body name: of a JSON object its members, else those of a form."""
        if self.body.lstrip()[:1] == b"{":
            return {**self.query, **self.json()}
        return {**self.query, **dict(parse_qsl(self.body.decode("utf-8", "replace")))}

    @property
    def of_apple(self) -> bool:
        """Whether a phone of Apple's sends it: its heights are above sea level, Android's above the ellipsoid."""
        agent = self.headers.get("user-agent", "").lower()
        return any(word in agent for word in ("darwin", "cfnetwork", "ios", "iphone"))

    def height(self, value: object) -> dict[str, object]:
        """A phone's own height as a column of a log."""
        return {"alt_msl_m" if self.of_apple else "height_ell_m": value}


Link = Callable[[str, str], str]
"""Makes a link that sets the program up, of the address and a name for the device."""


@dataclass(frozen=True)
class Sender:
    """A program that sends points."""

    name: str
    """In addresses."""
    title: str
    """What it calls itself."""
    read: Callable[[Message, Batch], None]
    """Puts the points of a message into a batch; ``BadRequestError`` where it is none of this program's."""
    answer: str = ""
    """What the program waits for."""
    media_type: str = "text/plain"
    typed: str = "{address}"
    """What is typed into the program where it asks for an address."""
    link: Link | None = None
    insists: bool = False
    """Sends what is refused again and again, and nothing else before: a bad point must not be refused."""


def mapping(value: object) -> Mapping[str, Any]:
    """A member of a JSON document that should be an object."""
    return value if isinstance(value, Mapping) else {}


def sequence(value: object) -> list[Any]:
    """A member of a JSON document that should be a list."""
    return value if isinstance(value, list) else []


def objects(value: object) -> list[Mapping[str, Any]]:
    """An object, or each of a list of them; ``BadRequestError`` for anything else."""
    listed: list[Any] = value if isinstance(value, list) else [value]
    if not all(isinstance(one, Mapping) for one in listed):
        raise BadRequestError(say("live.not_known"), field="body")
    return listed
