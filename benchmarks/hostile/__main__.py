"""Whether a service goes on working for a well-behaved client while others attack it.

    PYTHONPATH=.:benchmarks python -m hostile [--seconds 20] [--attacks NAME ...] [--same-address] [--json FILE]

A service is started as ``versant up`` starts it, with the roads and the elevation model of a simulated town and some
drives. Then come the attacks, each for so many seconds, one after the other and at last all at once, each from a
process and a loopback address of its own (127.0.0.2, 127.0.0.3, ...; with ``--same-address`` all from the client's).
Only the service that was started here is attacked.

    doubling filter    a filter of 120 characters whose operands would double 17 times
    idle bodies        40 changes and uploads of which one byte arrives
    slow filters       210 connections, each with one slow filter after the other
    event streams      800 of them
    half requests      1,100 connections with half a head
    endless heads      heads that never end, as fast as they are taken
    sparse raster      an import of ten kilobytes that say to be 400,000 x 400,000 posts
    unpacking bomb     an import of 3 MB that unpack to 3 GB
    many rows          a log of 3,000,000 rows in some 20 MB
    huge options       an ordinary log with ten million particles
    copies             logs of one short drive, alike but for their last line

Meanwhile a client on 127.0.0.1 uploads a drive every 4 s and asks for eight other things four times a second each,
every request on a new connection: probes, items, a filter, a tile, the list of drives, heights by POST (it waits where
changes wait) and the events of its last drive. ``nothing`` is the same without an attack.

    p50, p99, max    s of the worst kind of request; 10 s stand for no answer
    away             the longest time in which every request of a kind was answered by 503 or not at all, s
    drives           of the client: done within a minute after the attack, of those taken while it lasted
    memory           the most that any one process of that kind had, MB (PSS)

Good is a p99 below 2 s of every kind, nothing away for more than 5 s, and every drive that was taken done at the end.
"""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from accuracy.arguments import REPOSITORY, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from fusion.simulate.drive import simulate_drive
from fusion.simulate.scene.town import Town, make_town
from fusion.simulate.write.csv_file import write_csv
from fusion.simulate.write.dem_file import write_dem
from fusion.simulate.write.osm_file import write_osm
from hostile.attempts import ATTACKS
from hostile.service import Attacked, attacked, environment
from hostile.well_behaved import UPLOAD_EVERY_S, Client, Served, working

MOST_P99_S, MOST_AWAY_S = 2.0, 5.0
FIRST_DRIVES = 4
DRIVE_S = 60.0
AFTER_S, AT_THE_END_S = 60.0, 300.0
NOTHING, ALL = "nothing", "all at once"


@dataclass(frozen=True)
class Row:
    """One attack, and how the client was served meanwhile."""

    attack: str
    kinds: dict[str, Served]
    taken: int
    done: int
    """Within ``AFTER_S`` of its end."""
    memory_mb: dict[str, float]
    outcomes: dict[str, dict[str, int]]
    """What each attacker was answered, and how often."""

    @property
    def slowest(self) -> tuple[str, Served]:
        """The kind of request with the largest p99."""
        return max(self.kinds.items(), key=lambda item: item[1].p99_s)

    @property
    def away(self) -> tuple[str, Served]:
        """The kind that was turned away for longest."""
        return max(self.kinds.items(), key=lambda item: item[1].longest_away_s)

    @property
    def faults(self) -> list[str]:
        """What is beyond the bounds, in words."""
        lines = []
        for kind, answers in self.kinds.items():
            if not answers.p99_s < MOST_P99_S:
                lines.append(f"{self.attack}: p99 of {kind} is {answers.p99_s:.2f} s")
            if answers.longest_away_s > MOST_AWAY_S:
                lines.append(f"{self.attack}: {kind} was turned away for {answers.longest_away_s:.1f} s")
        return lines


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each attack")
    parser.add_argument("--attacks", nargs="*", choices=list(ATTACKS), default=list(ATTACKS), metavar="NAME")
    parser.add_argument("--same-address", action="store_true", help="attack from the client's own address")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="an empty folder to work in, which stays")
    args = parser.parse_args()
    folder = args.keep or Path(tempfile.mkdtemp(prefix="versant-hostile-"))
    folder.mkdir(parents=True, exist_ok=True)
    try:
        rows, lost = run(folder.resolve(), args.attacks, args.seconds, same_address=args.same_address)
    finally:
        if args.keep is None:
            shutil.rmtree(folder, ignore_errors=True)
    show_progress("")
    wrong = judgement(rows, lost)
    for line in report(rows, wrong):
        print(line)
    write_json(args.json, {"rows": [asdict(row) for row in rows], "lost": lost, "wrong": wrong})
    if wrong:
        sys.exit(1)


def run(
    folder: Path, names: Sequence[str], seconds: float, *, same_address: bool
) -> tuple[list[Row], dict[str, int]]:
    """Each attack, then all of them; the rows, and the client's drives that were never done, by their state."""
    town = make_town(1)
    a_phase = int(seconds / UPLOAD_EVERY_S) + 2
    write_osm(town, folder / "town.osm")
    write_dem(town, folder / "dem.tif")
    rows, drives = [], []
    with attacked(folder) as service:
        service.command("import-roads", str(folder / "town.osm"), "--region", "town")
        service.command("import-dem", str(folder / "dem.tif"))
        bbox, tile = _place(town)
        drives += [_upload(service, log) for log in _logs(town, folder, 0, FIRST_DRIVES)]
        (folder / "drive").write_text(drives[0])
        states_after(service, drives, AT_THE_END_S)
        service.memory.take()
        for k, attack in enumerate((NOTHING, *names, *([ALL] if len(names) > 1 else []))):
            show_progress(attack)
            # Made before, so that the client does nothing but ask.
            logs = _logs(town, folder, FIRST_DRIVES + k * a_phase, a_phase)
            client = Client(service.port, bbox, tile, iter(logs))
            chosen = {NOTHING: [], ALL: list(names)}.get(attack, [attack])
            with working(client):
                outcomes = make(service, chosen, seconds, same_address=same_address)
                time.sleep(0 if chosen else seconds)
            kinds = client.results()
            drives += client.drives
            states = states_after(service, client.drives, AFTER_S)
            rows.append(
                Row(attack, kinds, len(client.drives), states["done"], service.memory.take(), outcomes)
            )
        show_progress("coming to rest")
        lost = states_after(service, drives, AT_THE_END_S)
    return rows, {state: count for state, count in lost.items() if state != "done"}


def make(
    service: Attacked, names: Sequence[str], seconds: float, *, same_address: bool
) -> dict[str, dict[str, int]]:
    """Make these attacks at once, each as a process; what each was answered."""
    attackers = {
        name: subprocess.Popen(
            [sys.executable, "-m", "hostile.attempts", name, str(service.port),
             "127.0.0.1" if same_address else f"127.0.0.{2 + k}", str(seconds), str(service.folder)],
            cwd=REPOSITORY, env=environment(), stdout=subprocess.PIPE, text=True,
        )
        for k, name in enumerate(names)
    }  # fmt: skip
    outcomes = {}
    for name, attacker in attackers.items():
        try:
            output, _ = attacker.communicate(timeout=seconds + 60)
            outcomes[name] = json.loads(output)
        except (subprocess.TimeoutExpired, ValueError):
            attacker.kill()
            attacker.wait()
            outcomes[name] = {"the attacker did not end": 1}
    return outcomes


def states_after(service: Attacked, drives: Sequence[str], patience_s: float) -> Counter[str]:
    """In which states these drives are once none of them waits or runs any more, or the patience is over."""
    ends = time.monotonic() + patience_s
    while True:
        states = Counter(_state(service, drive) for drive in drives)
        if states["done"] + states["failed"] + states["404"] == len(drives) or time.monotonic() > ends:
            return states
        time.sleep(0.5)


def _state(service: Attacked, drive: str) -> str:
    status, document = service.get(f"/v1/drives/{drive}")
    return str(json.loads(document)["status"]) if status == 200 else str(status or "no answer")


def _upload(service: Attacked, log: bytes) -> str:
    client = Client(service.port, "", "", iter(()))
    status, document = client.ask("upload", "POST", "/v1/drives", log)
    if status != 202:
        sys.exit(f"a drive was not taken: {status} {document.decode(errors='replace')}")
    return str(json.loads(document)["id"])


def _logs(town: Town, folder: Path, begin: int, count: int) -> list[bytes]:
    """Short drives, each of another time; ``log.csv`` is the first of all."""
    logs = []
    for seed in range(begin, begin + count):
        path = folder / ("log.csv" if seed == 0 else "later.csv")
        write_csv(simulate_drive(town, seed, DRIVE_S, receiver="m8"), path)
        logs.append(path.read_bytes())
    return logs


def _place(town: Town) -> tuple[str, str]:
    """A box in the town's middle, and the tile of zoom 14 there."""
    lon, lat = float(town.node_lon_deg.mean()), float(town.node_lat_deg.mean())
    x, y = (lon + 180) / 360, (1 - math.asinh(math.tan(math.radians(lat))) / math.pi) / 2
    box = f"{lon - 0.01:.4f},{lat - 0.01:.4f},{lon + 0.01:.4f},{lat + 0.01:.4f}"
    return box, f"14/{int(x * 2**14)}/{int(y * 2**14)}"


def judgement(rows: Sequence[Row], lost: dict[str, int]) -> list[str]:
    """What is beyond the bounds; nothing: good."""
    wrong = [fault for row in rows for fault in row.faults]
    return wrong + [f"{count} of the client's drives: {state}" for state, count in lost.items()]


def report(rows: Sequence[Row], wrong: Sequence[str]) -> list[str]:
    """The table, what the attackers were answered, and the judgement."""
    table = [_cells(row) for row in rows]
    lines = [text_table(table, {name: (name, "") for name in table[0]}), ""]
    for row in rows:
        if row.attack != ALL:
            lines += [f"{name}: {outcomes}" for name, outcomes in row.outcomes.items()]
    return [*lines, "", *wrong, "Good." if not wrong else "Wrong: see above."]


def _cells(row: Row) -> dict[str, Any]:
    slow, slowest = row.slowest
    kind, away = row.away
    longest_s = max(answers.max_s for answers in row.kinds.values())
    return {
        "attack": row.attack,
        "asked": str(sum(answers.requests for answers in row.kinds.values())),
        "p50": f"{slowest.p50_s:.3f}",
        "p99": f"{slowest.p99_s:.2f} {slow}",
        "max": f"{longest_s:.2f}",
        "away": f"{away.longest_away_s:.1f} {kind}" if away.longest_away_s else "0",
        "drives": f"{row.done} of {row.taken}",
        **{f"{role} MB": f"{row.memory_mb.get(role, 0):.0f}" for role in ("api", "backend", "worker")},
    }


if __name__ == "__main__":
    main()
