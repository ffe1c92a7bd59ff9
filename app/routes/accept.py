"""Content negotiation (RFC 9110, section 12.5.1)."""

from __future__ import annotations

from collections.abc import Sequence


def preferred(accept: str | None, offered: Sequence[str]) -> str | None:
    """The media type of ``offered`` that the Accept header likes best, the first of equals; None: none.

    At equal weight a type that is named beats one that only a wildcard covers, which is what a browser's
    header for pictures means.
    """
    if not accept or not accept.strip():
        return offered[0]
    ranges = [_parsed(item) for item in accept.split(",") if item.strip()]
    best, best_rank = None, (0.0, 0)
    for media_type in offered:
        rank = _rank(media_type, ranges)
        if rank[0] > 0 and rank > best_rank:
            best, best_rank = media_type, rank
    return best


def _rank(media_type: str, ranges: list[tuple[str, float]]) -> tuple[float, int]:
    """(weight, how exactly it is named) by the most specific range that covers the type."""
    wildcard = media_type.split("/", maxsplit=1)[0] + "/*"
    matches = [
        (specific, weight)
        for name, weight in ranges
        if (specific := {media_type: 3, wildcard: 2, "*/*": 1}.get(name, 0))
    ]
    if not matches:
        return (0.0, 0)
    specific, weight = max(matches)
    return (weight, specific)


def _parsed(item: str) -> tuple[str, float]:
    name, *parameters = (part.strip().lower() for part in item.split(";"))
    weight = next((p[2:] for p in parameters if p.startswith("q=")), "1")
    try:
        return name, min(max(float(weight), 0.0), 1.0)
    except ValueError:
        return name, 0.0
