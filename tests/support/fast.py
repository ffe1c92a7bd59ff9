"""Options that make the default method fast enough for tests, whichever method it is."""

from __future__ import annotations

from typing import Any

from fusion.registry import DEFAULT_METHOD

FAST_OPTIONS: dict[str, Any] = {"particle": {"particles": 2000}}.get(DEFAULT_METHOD, {})
