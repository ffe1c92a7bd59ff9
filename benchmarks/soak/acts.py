"""What is done to a service while it is disturbed: clients, an operator and a killer, each at random, each a thread.

They note in one ledger what they did and what they were told.
"""

from __future__ import annotations

import gzip
import random
import subprocess
import threading
import time
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import httpx

from soak.disturbed import Disturbed
from soak.material import Material

ANSWER_S = 30.0
"""So long is waited for an answer."""
AGAIN_S = 1.0
"""Before anything else is asked of a service that is not there."""
IMPORT_S = 180.0
GZIPPED = 0.3
"""Share of the uploads."""
CUT_OFF, SAME_ROADS = 0.15, 0.3
"""Shares of the imports."""
KILLED = {"worker": 5, "API": 2, "postmaster": 2, "backend": 2, "PgBouncer": 2, "standby": 2}
"""How often each, of those that there are."""
TILE_PATH = "/tiles/{0.z}/{0.x}/{0.y}.mvt"
METHODS = ("profile", "profile", "profile", "raw")
"""Some drives say slopes alone, which are combined with those of the network."""


@dataclass
class Ledger:
    """What was done, and what the service has promised. Threads share it."""

    counts: Counter[tuple[str, str]] = field(default_factory=Counter)
    """How often what was done ended how."""
    promised: dict[str, int] = field(default_factory=dict)
    """Drives that an upload was answered with, and their logs."""
    asked_to_go: set[str] = field(default_factory=set)
    """Drives whose removal was asked for, whatever came of it."""
    going: set[str] = field(default_factory=set)
    """Those of which the service said that they go."""
    lock: threading.Lock = field(default_factory=threading.Lock)

    def count(self, act: str, ended: str) -> None:
        """Note that something was done."""
        with self.lock:
            self.counts[act, ended] += 1

    def faults(self) -> int:
        """How many answers were neither what was asked for nor one that a client has to reckon with."""
        expected = {"404", "503"}
        return sum(
            n for (_, end), n in self.counts.items() if end.isdigit() and end >= "400" and end not in expected
        )

    def drives(self) -> list[str]:
        """Drives that should be there, in the order in which they came."""
        with self.lock:
            return [drive for drive in self.promised if drive not in self.asked_to_go]


class Api:
    """The service over HTTP, and how it answered."""

    def __init__(self, service: Disturbed, ledger: Ledger, rng: random.Random) -> None:
        self._addresses, self._ledger, self._rng = service.parts.addresses, ledger, rng
        self._http = httpx.Client(timeout=ANSWER_S, trust_env=False)

    def ask(self, act: str, method: str, path: str, content: bytes | None = None) -> httpx.Response | None:
        """The answer, noted; None where there was none."""
        address = self._rng.choice(self._addresses)
        try:
            answer = self._http.request(method, address + path, content=content)
        except httpx.TransportError:
            self._ledger.count(act, "no answer")
            time.sleep(AGAIN_S)
            return None
        self._ledger.count(act, str(answer.status_code))
        return answer

    def reprocess_all(self) -> None:
        """Ask for all drives anew."""
        self.ask("reprocess all", "POST", "/v1/drives/reprocess?which=all")


class Common(NamedTuple):
    """What every actor has."""

    service: Disturbed
    ledger: Ledger
    rng: random.Random
    over: threading.Event


class Actor(ABC):
    """Acts at random until it is told that it is over."""

    def __init__(self, common: Common) -> None:
        self.service, self.ledger, self.rng, self.over = common
        self.api = Api(self.service, self.ledger, self.rng)
        self.error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    @abstractmethod
    def act(self) -> None:
        """Do one thing."""

    @abstractmethod
    def pause_s(self) -> float:
        """How long to wait before the next."""

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def join(self) -> None:
        """Wait for its end; raises what it met."""
        self._thread.join()
        if self.error is not None:
            raise self.error

    def _run(self) -> None:
        try:
            while not self.over.wait(self.pause_s()):
                self.act()
        except BaseException as error:  # raised where it is joined
            self.error = error


class Client(Actor):
    """Uploads, deletes, asks anew, and looks."""

    def __init__(self, common: Common, material: Material, pause_s: float) -> None:
        super().__init__(common)
        self._logs, self._mean_s = material.logs, pause_s
        self._map = [*map(TILE_PATH.format, material.tiles), "/collections/segments/items?driven=true"]
        self._acts: dict[Callable[[], None], int] = {
            self._upload: 12,
            self._delete: 4,
            self._reprocess: 4,
            self.api.reprocess_all: 1,
            self._look: 4,
            self._look_at_map: 4,
        }

    def pause_s(self) -> float:
        """Sometimes two things at once, sometimes nothing for a while."""
        return self.rng.expovariate(1 / self._mean_s)

    def act(self) -> None:
        """Upload most often."""
        self.rng.choices(list(self._acts), list(self._acts.values()))[0]()

    def _upload(self) -> None:
        number = self.rng.randrange(len(self._logs))
        packed = self.rng.random() < GZIPPED
        body = gzip.compress(self._logs[number], self.rng.randint(1, 9)) if packed else self._logs[number]
        act = "upload, gzipped" if packed else "upload"
        answer = self.api.ask(act, "POST", f"/v1/drives?method={self.rng.choice(METHODS)}", body)
        if answer is not None and answer.status_code in {200, 202}:
            with self.ledger.lock:
                self.ledger.promised[answer.json()["id"]] = number

    def _delete(self) -> None:
        if (drive := self._some_drive()) is None:
            return
        with self.ledger.lock:
            self.ledger.asked_to_go.add(drive)
        answer = self.api.ask("delete", "DELETE", f"/v1/drives/{drive}")
        if answer is not None and answer.status_code == 202:
            with self.ledger.lock:
                self.ledger.going.add(drive)

    def _reprocess(self) -> None:
        if (drive := self._some_drive()) is None:
            return
        method = f"?method={self.rng.choice(METHODS)}" if self.rng.random() < 0.5 else ""
        self.api.ask("reprocess", "POST", f"/v1/drives/{drive}/reprocess{method}")

    def _look(self) -> None:
        drive = self._some_drive()
        self.api.ask(
            "look", "GET", "/v1/drives" if drive is None or self.rng.random() < 0.5 else f"/v1/drives/{drive}"
        )

    def _look_at_map(self) -> None:
        self.api.ask("look at the map", "GET", self.rng.choice(self._map))

    def _some_drive(self) -> str | None:
        drives = self.ledger.drives()
        return self.rng.choice(drives) if drives else None


class Operator(Actor):
    """Imports roads: now these, now those, at last those that stay, after which all drives are asked for anew."""

    def __init__(self, common: Common, material: Material, changes_until_s: float, pause_s: float) -> None:
        """``changes_until_s`` (of ``time.monotonic``): the roads stay the same from there on."""
        super().__init__(common)
        self._maps, self._until_s, self._mean_s = material.maps, changes_until_s, pause_s
        self.last = "as it is"
        self.stays = self.rng.choice(list(material.maps))
        """The roads at the end."""
        self.stay = False
        """Whether they are there."""

    def pause_s(self) -> float:
        """Time for some drives in between."""
        return self.rng.uniform(0.3, 1.7) * self._mean_s

    def act(self) -> None:
        """Import, and be cut off at times."""
        if time.monotonic() > self._until_s and not self.stay:
            self.let_stay()
            return
        same = self.rng.random() < SAME_ROADS and self.last
        others = [name for name in self._maps if name != self.last]
        which = self.stays if self.stay else self.last if same else self.rng.choice(others)
        self.import_roads(which, cut_off=self.rng.random() < CUT_OFF)

    def let_stay(self) -> None:
        """Import the roads that stay, and ask for all drives anew: what they said of roads that went is gone."""
        self.stay = self.import_roads(self.stays)
        if self.stay:
            self.api.reprocess_all()

    def import_roads(self, which: str, *, cut_off: bool = False) -> bool:
        """Whether it came to its end."""
        act = "import, same roads" if which == self.last else "import, other roads"
        process = self.service.begin("import-roads", str(self._maps[which]), "--region", "soak", "--yes")
        try:
            status = process.wait(self.rng.uniform(1.0, 6.0) if cut_off else IMPORT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            self.ledger.count(act, "killed" if cut_off else "too long")
            self.last = ""  # nobody knows
            return False
        self.ledger.count(act, "done" if status == 0 else "failed")
        self.last = which if status == 0 else ""
        return status == 0


class Killer(Actor):
    """Kills each kind of process once, then any."""

    def __init__(self, common: Common, pause_s: float) -> None:
        super().__init__(common)
        self._mean_s = pause_s
        self._first = list(self.service.kills)
        self.rng.shuffle(self._first)

    def pause_s(self) -> float:
        """Neither at once nor regularly."""
        return self.rng.uniform(0.2, 1.8) * self._mean_s

    def act(self) -> None:
        """Kill something."""
        often = {kind: n for kind, n in KILLED.items() if kind in self.service.kills}
        kind = self._first[-1] if self._first else self.rng.choices(list(often), list(often.values()))[0]
        killed = self.service.kills[kind](self.rng)
        self.ledger.count(f"kill, {kind}", "done" if killed else "spared")
        if killed and self._first:
            self._first.pop()
