"""The service's sentences for people, beside the library's (``fusion.messages``), and how documents hold their keys."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel, Field

from fusion.messages import Message, add_catalogues, catalogue, said
from fusion.messages import say as say

SAID = "null where it has none. Pages say it so in their reader's language."

add_catalogues(Path(__file__).parent)
add_catalogues(Path(__file__).parent / "commands")  # what no page loads: command line, pictures


class Said(BaseModel):
    """A sentence as its key in the catalogues of messages, with what the template of that key is filled with."""

    key: str
    parameters: dict[str, Any] = Field(description="Numbers, texts, lists, and sentences like this one.")

    @classmethod
    def of(cls, text: str) -> Said | None:
        """Of a sentence; None where it has no key."""
        key = said(text)
        return None if key is None else cls(**key)


def with_fault(text: str, item: Mapping[str, Any]) -> str:
    """What a validator says in ``text`` of one of its ``errors()``, with a key where the catalogues have one."""
    key = f"field.{item['type']}"
    return Message(text, key, item.get("ctx", {})) if key in catalogue("en") else text


def said_in(columns: Mapping[str, Any]) -> dict[str, Any]:
    """The keys of a failure's reason and place in the columns of a row."""
    both = columns["failure_said"] or {}
    return {"said": both.get("reason"), "where_said": both.get("where")}
