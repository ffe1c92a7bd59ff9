"""A service that phones and trackers send points to, and what makes silence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import httpx
import pytest
from sqlalchemy import text

from access_support import Keyed
from app.core.db import Sessions
from app.drives.live.closing import Closer
from app.drives.live.points import US, LivePoint
from live_senders import Sent
from web_fixtures import Web


def near(a: float | None, b: float | None) -> bool:
    """Whether two values are the same but for the last digits of a unit's change."""
    return a is None or b is None or math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-6)


def silent(sessions: Sessions, hours: float = 1.0) -> None:
    """Let so much time pass in which nothing comes."""
    with sessions.begin() as session:
        past = "seen_at = seen_at - :h * interval '1 hour', due_at = now()"
        statement = f"UPDATE live_streams SET {past} WHERE due_at IS NOT NULL"
        session.execute(text(statement), {"h": hours})


def close(web: Web) -> None:
    """Silence, and a worker's look."""
    silent(web.sessions)
    closer = Closer(web.sessions, web.blobs, web.settings)
    while closer.look():
        pass


@dataclass
class Live:
    """A service that asks for keys, and Anna's address for each program."""

    keyed: Keyed
    secrets: dict[str, str] = field(default_factory=dict)

    @property
    def web(self) -> Web:
        """The service."""
        return self.keyed.web

    def secret(self, name: str = "phone") -> str:
        """Of an address of that name."""
        if name not in self.secrets:
            self.secrets[name] = self.keyed.holder(self.keyed.a.id, "live", name).secret
        return self.secrets[name]

    def send(self, sender: str, sent: Sequence[Sent], name: str = "phone") -> list[httpx.Response]:
        """Let a program send that to its address."""
        path = f"/v1/live/{sender}/{self.secret(name)}"
        return [one.to(self.web.client, path) for one in sent]

    def drives(self) -> list[dict[str, Any]]:
        """Anna's, the first in front."""
        answer = self.keyed.a.own.get("/v1/drives").json()
        return sorted(answer["drives"], key=lambda one: str(one["filename"]))

    def log(self, drive: dict[str, Any]) -> bytes:
        """As its owner downloads it."""
        answer = self.keyed.a.own.get(f"/v1/drives/{drive['id']}/log")
        assert answer.status_code == 200, answer.text
        return answer.content

    def waiting(self) -> int:
        """Points that are in no log."""
        with self.web.sessions() as session:
            return int(session.execute(text("SELECT count(*) FROM live_points")).scalar_one())


@pytest.fixture
def live(keyed: Keyed) -> Live:
    """An empty service."""
    return Live(keyed)


def logs(live: Live) -> list[bytes]:
    """Of Anna's drives, by their names."""
    return [live.log(one) for one in live.drives()]


def expected(points: list[LivePoint]) -> bytes:
    """What OsmAnd's requests for these points are as a log."""
    lines = ["time_s,lat_deg,lon_deg,alt_msl_m,h_acc_m,speed_mps,heading_deg"]
    lines += [f"{p.time_us // US},{p.lat_deg},{p.lon_deg},{p.height_ell_m},4.0,15.0,1.0" for p in points]
    return ("\n".join(lines) + "\n").encode()
