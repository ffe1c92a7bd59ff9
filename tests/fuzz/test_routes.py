"""Every route of the OpenAPI document, asked for what it may be asked and for what it may not: no 500, none that hangs.

Requests are drawn by schemathesis. The document names no links, so what answers call ``id`` becomes a part of later
paths. A failure prints the request; in the suite they are the same each time, ``make fuzz`` draws others.
"""

from __future__ import annotations

import contextlib
import itertools
import random
import re
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from typing import Any

import pytest
import requests
import schemathesis
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import APIOperation, Case, GenerationMode

from fuzz_support import first_seed, rounds
from web_fixtures import Web

pytestmark = pytest.mark.filterwarnings("default")  # what the drawing library and its parts warn of is theirs

LONGEST_S = 5.0
MOST_KEPT = 50
EXAMPLES = 1
"""Of each operation and mode in a round."""
STREAM = re.compile(r"/events$")
"""What is answered until the client leaves."""
_PARAMETER = re.compile(r"\{(\w+)\}")
_SUBJECT = re.compile(r"/(?:v1/|collections/)?(\w+)")


class Routes:
    """A service that is asked, and what it called its things."""

    def __init__(self, web: Web) -> None:
        document = web.client.get("/openapi.json").json()
        self.operations: list[APIOperation[Any, Any, Any, Any]] = [
            found.ok() for found in schemathesis.openapi.from_dict(document).get_all_operations()
        ]
        self._base = web.base
        self._session = requests.Session()
        self._session.trust_env = False
        self.statuses: Counter[int] = Counter()
        self._ids: dict[str, list[str]] = defaultdict(list)

    def draw(self, operation: APIOperation[Any, Any, Any, Any], mode: GenerationMode, number: int) -> None:
        """A few requests of one operation."""

        @seed(number)
        @settings(
            max_examples=EXAMPLES,
            phases=[Phase.generate],
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
        )
        @given(operation.as_strategy(generation_mode=mode))
        def one(case: Case[Any]) -> None:
            rng = random.Random(f"{number} {operation.label} {mode}")  # noqa: S311 - not for secrets
            query = dict(case.query or {})
            needed = {one.name for one in operation.query if one.is_required}
            self._ask(case, rng)
            # Of many parameters one is nearly always refused, and no other looked at.
            for name in rng.sample(sorted(query), min(2, len(query))):
                case.query = {key: value for key, value in query.items() if key in {*needed, name}}
                self._ask(case, rng)

        with contextlib.suppress(Unsatisfiable):  # where nothing can be asked for, nothing can be spoilt
            one()

    def _ask(self, case: Case[Any], rng: random.Random) -> None:
        names = _PARAMETER.findall(case.operation.path)
        known = self._ids[subject_of(case.operation.path)]
        if names and names[0].endswith("_id") and known and rng.random() < 0.7:
            case.path_parameters = {**(case.path_parameters or {}), names[0]: rng.choice(known)}
        begin_s = time.monotonic()
        sent = case.as_transport_kwargs(base_url=self._base)
        try:
            with self._session.request(
                **sent, stream=True, timeout=LONGEST_S, allow_redirects=False
            ) as answer:
                body = b"" if STREAM.search(case.operation.path) else answer.content
        except requests.exceptions.InvalidHeader:
            return  # no client could send it
        took_s = time.monotonic() - begin_s
        told = f"{took_s:.1f} s, {answer.status_code} {body[:500]!r}\n{case.as_curl_command()[:3000]}"
        assert answer.status_code < 500 or answer.status_code == 503, told
        assert took_s < LONGEST_S, told
        self.statuses[answer.status_code // 100] += 1
        self._note(case.operation.path, answer, body)

    def _note(self, path: str, answer: requests.Response, body: bytes) -> None:
        if (
            not body
            or answer.status_code >= 300
            or not answer.headers.get("content-type", "").endswith("json")
        ):
            return
        document = answer.json()
        kept = self._ids[subject_of(path)]
        for one in _things(document):
            if str(one) not in kept:
                kept.append(str(one))
        del kept[:-MOST_KEPT]


def subject_of(path: str) -> str:
    """What a path is about: ``drives`` of ``/v1/drives/{drive_id}/track``."""
    found = _SUBJECT.match(path)
    return found[1] if found else ""


def _things(document: Any) -> Iterator[Any]:
    if isinstance(document, dict):
        if isinstance(document.get("id"), str | int):
            yield document["id"]
        for value in document.values():
            if isinstance(value, list):
                yield from (one["id"] for one in value if isinstance(one, dict) and "id" in one)


def test_no_route_fails_or_hangs_whatever_it_is_asked(filled: Web, drive_maker: Any) -> None:
    for slope_percent in (3.0, -1.0):
        drive_maker(filled.sessions, [0, 1, 2, 3], slope_percent)
    routes = Routes(filled)
    first = first_seed()
    asked: set[str] = set()
    for number in rounds(0.5):
        order = random.Random(first + number).sample(routes.operations, len(routes.operations))  # noqa: S311
        for operation, mode in itertools.product(order, (GenerationMode.POSITIVE, GenerationMode.NEGATIVE)):
            try:
                routes.draw(operation, mode, first + number)
            except Exception as error:
                error.add_note(f"seed {first + number}, {operation.label}, {mode}")
                raise
            asked.add(operation.label)
    assert len(asked) == len(routes.operations) > 90
    assert min(routes.statuses[2], routes.statuses[4]) > 30, (
        routes.statuses
    )  # it is answered, and it is refused
    assert filled.client.get("/readyz").status_code == 200
