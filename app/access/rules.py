"""Who may ask for what: one table of all routes. A route that is not in it is nobody's but an operator's.

A rule says what a caller needs. Whose drive it is, is not said here: what is another owner's is not there for the
caller, by row level security.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from enum import Enum
from functools import lru_cache

from starlette.routing import compile_path


class Rule(Enum):
    """What a route needs."""

    OPEN = "open"
    """Nothing: it tells nothing of anybody."""
    MAP = "map"
    """Nothing where the map is public, else `own`."""
    LIVE = "live"
    """A key, as a header or in the address (`app.access.gate.capability_of`): nobody is known by a cookie."""
    UPLOAD = "upload"
    OWN = "own"
    OPERATE = "operate"


_TABLE = {
    Rule.OPEN: """
        GET /
        GET /admin
        GET /conformance
        GET /docs
        GET /docs/contents.json
        GET /docs/{path:path}
        GET /drives
        GET /drives/{drive_id}
        GET /glyphs/{fontstack}/{range}.pbf
        GET /healthz
        GET /keys
        GET /login
        GET /map
        GET /openapi.json
        GET /owner
        GET /phones
        GET /problems
        GET /problems/{slug}
        GET /qgis/plugins.xml
        GET /qgis/slopes.qml
        GET /qgis/versant.zip
        GET /readyz
        GET /record
        GET /sprites/{file}
        GET /style.json
        GET /tileMatrixSets
        GET /tileMatrixSets/WebMercatorQuad
        GET /upload
        GET /v1/methods
        GET /v1/privacy
        GET /v1/removals/{removal_id}
        GET /v1/session
        GET /v1/session/oidc
        GET /v1/session/oidc/done
        POST /v1/session
        DELETE /v1/session
        GET /web/{name:path}
        OPTIONS /v1/uploads
        GET /v1/live/senders
    """,
    Rule.LIVE: """
        GET /v1/live/last
        GET /v1/live/last/{capability}
        GET /v1/live/{sender}
        POST /v1/live/{sender}
        GET /v1/live/{sender}/{capability}
        POST /v1/live/{sender}/{capability}
    """,
    Rule.MAP: """
        GET /collections
        GET /collections/{collection_id}
        GET /collections/{collection_id}/{rest:path}
        GET /height
        POST /height
        GET /collections/segments
        GET /collections/segments/items
        GET /collections/segments/items/{item_id}
        GET /collections/segments/queryables
        GET /collections/segments/schema
        GET /collections/segments/sortables
        GET /collections/ways
        GET /collections/ways/items
        GET /collections/ways/items/{item_id}
        GET /collections/ways/queryables
        GET /collections/ways/schema
        GET /collections/ways/sortables
        GET /collections/{collection}/tiles
        GET /collections/{collection}/tiles/WebMercatorQuad
        GET /collections/{collection}/tiles/WebMercatorQuad/{tileMatrix}/{tileRow}/{tileCol}
        GET /collections/{collection}/tiles/WebMercatorQuad/{tileMatrix}/{tileRow}/{tileCol}.mvt
        GET /collections/{collection}/tiles/WebMercatorQuad/{tileMatrix}/{tileRow}/{tileCol}.pbf
        GET /names.json
        GET /names/{z}/{x}/{y}.mvt
        GET /tiles
        GET /tiles.json
        GET /tiles/WebMercatorQuad
        GET /tiles/WebMercatorQuad/{tileMatrix}/{tileRow}/{tileCol}
        GET /tiles/WebMercatorQuad/{tileMatrix}/{tileRow}/{tileCol}.mvt
        GET /tiles/WebMercatorQuad/{tileMatrix}/{tileRow}/{tileCol}.pbf
        GET /tiles/{z}/{x}/{y}.geojson
        GET /tiles/{z}/{x}/{y}.mvt
        GET /tiles/{z}/{x}/{y}.pbf
        GET /v1/changes
        GET /v1/changes/events
        GET /v1/editions
        GET /v1/editions/{number}
        GET /v1/editions/{number}/{name}
        GET /v1/elevation
        POST /v1/energy
        GET /v1/exports/formats
        GET /v1/regions
        GET /v1/segments/{segment_id}
        GET /v1/segments/{segment_id}/profile
    """,
    Rule.UPLOAD: """
        POST /v1/drives
        POST /v1/drives/columns
        POST /v1/uploads
        GET /v1/uploads/{upload_id}
        PATCH /v1/uploads/{upload_id}
        DELETE /v1/uploads/{upload_id}
        GET /v1/drives/{drive_id}
        GET /v1/drives/{drive_id}/events
    """,
    Rule.OWN: """
        GET /v1/drives
        DELETE /v1/drives/{drive_id}
        GET /v1/drives/{drive_id}/columns
        GET /v1/drives/{drive_id}/log
        GET /v1/drives/{drive_id}/measurements
        GET /v1/drives/{drive_id}/profile
        POST /v1/drives/{drive_id}/reprocess
        GET /v1/drives/{drive_id}/segments
        GET /v1/drives/{drive_id}/track
        GET /v1/drives/{drive_id}/trials
        POST /v1/drives/{drive_id}/trials
        GET /v1/drives/{drive_id}/trials/{trial_id}
        DELETE /v1/drives/{drive_id}/trials/{trial_id}
        GET /v1/drives/{drive_id}/trials/{trial_id}/measurements
        GET /v1/drives/{drive_id}/trials/{trial_id}/profile
        GET /v1/drives/{drive_id}/trials/{trial_id}/segments
        POST /v1/drives/remove
        POST /v1/drives/reprocess
        GET /v1/drives/reprocess
        DELETE /v1/drives/reprocess
        GET /v1/exports
        POST /v1/exports
        GET /v1/exports/{export_id}
        DELETE /v1/exports/{export_id}
        GET /v1/exports/{export_id}/beside/{name}
        GET /v1/exports/{export_id}/file
        GET /v1/live
        POST /v1/live/addresses
        GET /v1/keys
        POST /v1/keys
        DELETE /v1/keys/{key_id}
        POST /v1/keys/{key_id}/rotate
        GET /v1/owner
        PATCH /v1/owner
        DELETE /v1/owner
        GET /v1/owner/archive
        GET /v1/owner/zones
        PUT /v1/owner/zones
        GET /v1/segments/{segment_id}/observations
        GET /v1/webhooks
        POST /v1/webhooks
        GET /v1/webhooks/{webhook_id}
        PATCH /v1/webhooks/{webhook_id}
        DELETE /v1/webhooks/{webhook_id}
        POST /v1/webhooks/{webhook_id}/test
    """,
    Rule.OPERATE: """
        GET /metrics
        GET /v1/admin
        GET /v1/admin/stats
        GET /v1/admin/{name}
        GET /v1/operations
        POST /v1/operations
        GET /v1/operations/{operation_id}
        DELETE /v1/operations/{operation_id}
        POST /v1/operations/{operation_id}/approve
        GET /v1/owners
        POST /v1/owners
        GET /v1/owners/{owner_id}
        PATCH /v1/owners/{owner_id}
        DELETE /v1/owners/{owner_id}
        GET /v1/owners/{owner_id}/archive
        GET /v1/rasters
    """,
}


def _rules() -> Iterator[tuple[str, str, Rule]]:
    for rule, lines in _TABLE.items():
        for line in lines.split("\n"):
            if line.strip():
                method, path = line.split()
                yield method, path, rule


ROUTES: dict[tuple[str, str], Rule] = {(method, path): rule for method, path, rule in _rules()}
"""(method, path as routes write it) -> rule."""


class Rules:
    """The rule of each request, for the routes that an application has, in their order."""

    def __init__(self, routes: Iterable[tuple[str, str]]) -> None:
        """``routes``: method and path of each, the one that is asked first in front."""
        known = list(routes)
        self._fixed: dict[tuple[str, str], Rule] = {}
        self._patterns: dict[str, re.Pattern[str]] = {}
        self._rules: dict[str, list[Rule]] = {}
        for method in {method for method, _ in known}:
            paths = [path for verb, path in known if verb == method]
            self._fixed |= {(method, p): _rule(method, p) for p in paths if "{" not in p}
            with_names = [path for path in paths if "{" in path]
            self._rules[method] = [_rule(method, path) for path in with_names]
            # One pattern: which of a hundred alternatives fits costs as much as asking three.
            self._patterns[method] = re.compile("|".join(f"(?:{_nameless(path)})()" for path in with_names))
        self.of = lru_cache(maxsize=10_000)(self._of)
        """The rule of a request by its method and its path; what no route answers is open: a 404 or 405."""

    def _of(self, method: str, path: str) -> Rule:
        if (rule := self._fixed.get((method, path))) is not None:
            return rule
        pattern = self._patterns.get(method)
        match = pattern.fullmatch(path) if pattern is not None else None
        return (
            Rule.OPEN
            if match is None or match.lastindex is None
            else self._rules[method][match.lastindex - 1]
        )


def _rule(method: str, path: str) -> Rule:
    return ROUTES.get((method, path), Rule.OPERATE)


def _nameless(path: str) -> str:
    pattern = compile_path(path)[0].pattern.removeprefix("^").removesuffix("$")
    return re.sub(r"\(\?P<\w+>", "(?:", pattern)
