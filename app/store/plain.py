"""Values as PostgreSQL's text and JSON can hold them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any


def plain_text(value: str | None) -> Any:
    """``value`` without the NUL characters that PostgreSQL's text cannot hold."""
    return None if value is None else value.replace("\x00", "\ufffd")


def plain_json(value: Any) -> Any:
    """``value`` with what PostgreSQL's JSON cannot hold replaced: NaN, infinities by null, NUL by U+FFFD."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return plain_text(value)
    if isinstance(value, Mapping):
        return {plain_text(str(key)): plain_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(item) for item in value]
    return value
