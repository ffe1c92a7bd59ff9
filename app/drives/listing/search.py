"""What people search drives by: the beginnings of words of a file's name, or of an id.

Both are answered from an index, however many drives there are: words by one of migration 0026, which takes a name apart
at whatever is neither letter nor digit and between both; so `karl 2026` finds `2026-11-20_Karlsruhe.csv`.
"""

from __future__ import annotations

import re
import uuid
from typing import Any

from sqlalchemy import text
from sqlalchemy.orm import Session

# The words are made by the function that the index is made by. They are asked for first: only what it is told as a
# constant lets the server see whether few or many drives have such a name.
_WORDS = text(
    "SELECT string_agg(quote_literal(word) || ':*', ' & ') FROM unnest(tsvector_to_array(file_words(:q))) AS word"
)
_NAMED = "file_words(d.filename) @@ CAST(:q_words AS tsquery)"
_OF_ID = "d.id BETWEEN :q_first AND :q_last"
_ID_LENGTH = 32
_ID = re.compile(r"[0-9a-f]{8,32}")
"""The beginning of an id that is long enough to be meant as one."""


def matching(session: Session, q: str) -> tuple[str, dict[str, Any]]:
    """The condition, which begins with AND, and its values."""
    conditions: list[str] = []
    values: dict[str, Any] = {}
    if words := session.execute(_WORDS, {"q": q.replace("\0", " ")}).scalar():
        conditions.append(_NAMED)
        values["q_words"] = words
    digits = q.strip().lower().replace("-", "")
    if _ID.fullmatch(digits):
        conditions.append(_OF_ID)
        values["q_first"] = uuid.UUID(digits.ljust(_ID_LENGTH, "0"))
        values["q_last"] = uuid.UUID(digits.ljust(_ID_LENGTH, "f"))
    return f" AND ({' OR '.join(conditions) or 'false'})", values
