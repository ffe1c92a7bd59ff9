"""A soak: a real service under clients, imports and SIGKILL at random, and whether it is right when it rests.

    PYTHONPATH=.:benchmarks python -m soak [--seconds 600] [--seed N] [--logs 40] [--machines 2] [--keep DIR]
        [--json FILE]

An embedded cluster, an API and two workers run as ``versant up`` runs them. Two clients upload short drives through the
simulated town (some gzipped, some by a method that says slopes alone), delete them, ask for one or all anew and look;
an operator imports roads: the same again, some nodes moved, a street missing, and is cut off at times; a killer kills
the API, workers, PostgreSQL's postmaster and its backends. For the last third of the time the roads stay as they are by
then. All of it follows the seed, but for its timing. Then everything is left alone until nothing is left to be done.

With ``--machines 2`` the service is spread (``fleet``): PgBouncer before the database, a hot standby, three APIs of
which two read from it, two machines of six lanes. PgBouncer and the standby are killed as well, and connections are
counted.

Wrong is whatever is not 0 in the second table, fewer than 99 % of the driven segments within 0.1 sigma of a computation
from scratch (the drives that are there, on the roads that are there, one after the other, settled), and any farther
than 0.01 sigma from it once the service is settled too. Then the exit status is 1 and the folder is kept.
"""

from __future__ import annotations

import random
import secrets
import shutil
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from accuracy.arguments import parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.network.settle import settle_network
from service.databases import sessions_of
from soak import judging
from soak.acts import Actor, Client, Common, Killer, Ledger, Operator
from soak.disturbed import Disturbed, disturbed
from soak.fleet import fleet
from soak.judging import Far
from soak.material import Material, make_material
from soak.scratch import from_scratch

CLIENTS = 2
CHANGING_SHARE = 2 / 3
"""Of the time, in which roads change."""
IMPORTS, KILLS = 40, 60
"""About so many, unless the time between two were shorter than ..."""
LEAST_PAUSE_S = 5.0
LONG_S = 600.0
TRIES = 5
"""To bring in the roads that stay, and every drive up to them, when nothing is killed any more."""
ACTS_EVERY_S = 0.6
"""Of each client, on average."""


@dataclass(frozen=True)
class Result:
    """What was done and what was found."""

    seed: int
    seconds: float
    acts: dict[str, dict[str, int]]
    wrong: dict[str, int]
    drives: int
    orphans: int
    rest_s: float
    far: Far | None
    """None where a computation from scratch would show nothing: not all is at rest."""
    said: list[str]
    """Why drives failed."""
    connections: list[dict[str, float | str]]
    """Of several machines: by where they lead and what they call themselves, at once."""

    @property
    def good(self) -> bool:
        """Whether nothing is wrong."""
        return (
            not any(self.wrong.values())
            and self.far is not None
            and self.far.at_once_sigmas <= judging.AT_ONCE_SIGMAS
            and self.far.settled_sigmas <= judging.SETTLED_SIGMAS
            and not self.far.other_segments
        )


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    parser.add_argument("--seconds", type=float, default=LONG_S)
    parser.add_argument("--seed", type=int, default=secrets.randbelow(10_000), help="default: any")
    parser.add_argument("--logs", type=int, default=40)
    parser.add_argument(
        "--machines", type=int, default=1, help="with lanes; more than 1: PgBouncer, a standby, 3 APIs"
    )
    parser.add_argument("--keep", type=Path, metavar="DIR", help="an empty folder to work in, which stays")
    args = parser.parse_args()
    folder = args.keep or Path(tempfile.mkdtemp(prefix="versant-soak-"))
    folder.mkdir(parents=True, exist_ok=True)
    print(f"soak of {args.seconds:.0f} s, --seed {args.seed}", flush=True)
    result = soak(folder, args.seconds, args.seed, args.logs, args.machines)
    show_progress("")
    for line in report(result):
        print(line)
    write_json(args.json, {**asdict(result), "good": result.good})
    if not result.good:
        sys.exit(f"Something is wrong. What the service said is in {folder / 'service.log'}.")
    if args.keep is None:
        shutil.rmtree(folder)


def soak(folder: Path, seconds: float, seed: int, logs: int, machines: int = 1) -> Result:
    """Run it in a folder."""
    material = make_material(folder, logs, seed)
    with disturbed(folder) if machines == 1 else fleet(folder, machines) as service:
        for command in (
            ("import-roads", str(material.maps["as it is"]), "--region", "soak"),
            ("import-dem", str(material.dem)),
        ):
            if service.begin(*command).wait():
                raise RuntimeError(f"{command[0]} failed: {service.log.read_text()[-2000:]}")
        ledger = Ledger()
        with nullcontext() if service.connections is None else service.connections.counted():
            operator, began = disturb(service, ledger, material, seconds, seed)
        remains = come_to_rest(service, operator)
        rest_s = time.monotonic() - began
        wrong, there, said = judging.drives_at_the_end(service, ledger, material)
        distance = None
        if not remains:
            wrong["other tiles"] = judging.other_tiles(service, material)
            at_once = judging.slopes_of(service.url)
            _settle(service)
            settled = judging.slopes_of(service.url)
            show_progress("from scratch")
            rng = random.Random(f"{seed} scratch")  # noqa: S311 - no secret
            scratch = from_scratch(service, folder / "scratch", material, operator.stays, there, rng)
            distance = judging.far(at_once, settled, scratch)
        return Result(
            seed,
            seconds,
            _by_act(ledger.counts),
            {**wrong, "faults": ledger.faults(), "stuck": 0, **{f"stuck {k}": n for k, n in remains.items()}},
            len(there),
            judging.orphans(service),
            rest_s,
            distance,
            said,
            [] if service.connections is None else service.connections.rows(),
        )


def disturb(
    service: Disturbed, ledger: Ledger, material: Material, seconds: float, seed: int
) -> tuple[Operator, float]:
    """Let everybody act for so long; the operator, and when it was over."""
    over = threading.Event()
    begin = time.monotonic()

    def common(name: str) -> Common:
        return Common(service, ledger, random.Random(f"{seed} {name}"), over)  # noqa: S311 - no secret

    pause_s = {n: max(LEAST_PAUSE_S, seconds / n) for n in (IMPORTS, KILLS)}
    operator = Operator(common("operator"), material, begin + CHANGING_SHARE * seconds, pause_s[IMPORTS])
    actors: list[Actor] = [operator, Killer(common("killer"), pause_s[KILLS])]
    actors += [Client(common(f"client {k}"), material, ACTS_EVERY_S) for k in range(CLIENTS)]
    for actor in actors:
        actor.start()
    while (left_s := begin + seconds - time.monotonic()) > 0 and not any(actor.error for actor in actors):
        show_progress(f"{left_s:.0f} s to go, {sum(ledger.counts.values())} acts")
        time.sleep(min(1.0, left_s))
    over.set()
    ended = time.monotonic()
    for actor in actors:
        actor.join()
    return operator, ended


def come_to_rest(service: Disturbed, operator: Operator) -> dict[str, int]:
    """Let nothing be left to be done, nor any drive that was computed on other roads; what is left after all."""
    show_progress("coming to rest")
    for _ in range(TRIES):
        if not operator.stay:
            operator.let_stay()
        if remains := judging.await_rest(service):
            return remains
        stale = judging.stale_drives(service)
        if operator.stay and not stale:
            return {}
        for drive in stale:
            operator.api.ask("reprocess, stale", "POST", f"/v1/drives/{drive}/reprocess")
    return {"on other roads": len(judging.stale_drives(service))}


def _settle(service: Disturbed) -> None:
    with sessions_of(service.url) as sessions:
        settle_network(sessions)


def _by_act(counts: Counter[tuple[str, str]]) -> dict[str, dict[str, int]]:
    return {
        act: {ended: n for (one, ended), n in sorted(counts.items()) if one == act}
        for act in sorted({act for act, _ in counts})
    }


def report(result: Result) -> list[str]:
    """Two tables, and a sentence."""
    acts: list[dict[str, Any]] = [
        {
            "act": act,
            "times": sum(ends.values()),
            "ended": ", ".join(f"{end}: {n}" for end, n in ends.items()),
        }
        for act, ends in result.acts.items()
    ]
    rows = [{"found": name, "count": count} for name, count in result.wrong.items()]
    lines = [text_table(acts, {"act": ("done", ""), "times": ("times", "d"), "ended": ("ended", "")}), ""]
    lines += [text_table(rows, {"found": ("wrong", ""), "count": ("count", "d")}), ""]
    if result.connections:
        columns = {"what": ("connections at once", ""), "mean": ("mean", ".1f"), "most": ("most", "d")}
        lines += [text_table(result.connections, columns), ""]
    lines += result.said
    lines.append(
        f"{result.drives} drives are there, {result.orphans} logs without one; at rest after {result.rest_s:.0f} s."
    )
    if (far := result.far) is not None:
        lines.append(
            f"{far.segments} segments from scratch: at once {100 * judging.AT_ONCE_SHARE:.0f} % are within "
            f"{far.at_once_sigmas:.2g} sigma and all within {far.at_once_all_sigmas:.2g}; settled, all are within "
            f"{far.settled_sigmas:.2g} sigma and {far.other_segments} others."
        )
    lines.append(f"{'Good' if result.good else 'Wrong'} (--seed {result.seed}).")
    return lines


if __name__ == "__main__":
    main()
