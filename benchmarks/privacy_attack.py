#!/usr/bin/env python3
"""What the public can find out about people from the map: an attack on the live map and on editions, and a guesser.

    PYTHONPATH=.:benchmarks python benchmarks/privacy_attack.py [--roads FILE.osm.pbf] [--owners 200] [--drives 400]
                                              [--editions 4] [--removals 3] [--seed 1] [--quick]
                                              [--plot FILE] [--json FILE]

Owners live in quiet streets of Heidelberg, work in a few places and shop near by; each has a taste of roads. Their
drives are stored as workers store them (passes and tracks of simulated receivers), so many a week, and every week ends
with an edition. All is read over HTTP without a key. The attacker knows the roads, how many owners and drives there
are, and has k - 1 accounts that drive over every road before each edition, so that one owner more would tip a count. It
names as many drives (sets of segments) as there are, and as many homes (places) as there are owners:

    live        from the live map, looking after each drive
    editions    from what each edition tells that the former one did not (k = 3, k - 1 colluders: 5 owners are needed)
    of 3        the same where the service reckons with no colluders: 3 owners are needed, two of them the attacker's
    last, of 3  a guesser that reads the last edition alone, by the same method: the map of all
    roads       a guesser that knows which roads anybody drove, to their ends, and not how often

    drives %    true drives with which a name agrees: F1 by length of 0.7; a name counts once
    homes %     true homes within 200 m of a name; a name counts once. In a town many are near any point
    doors %     the same within 50 m, of names for that

Intervals of 95 % are drawn owner by owner. ``beyond`` is by how much more an attack names than the guesser with the
edition of its own. Then: what the public cannot see at k = 3, 5 and 10 after all editions, without accounts of an
attacker; and what two editions tell when nothing but the removal of one owner lies between them.

Aims: live above 90 % of drives and above half of the homes; editions not beyond the guesser, within the interval.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import tempfile
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from accuracy.arguments import add_roads, parser_of
from accuracy.scoring import show_progress, text_table, write_json
from app.embedded.cluster import EmbeddedPostgres
from privacy.attacks import (
    Editions,
    Names,
    World,
    attack_editions,
    attack_live,
    guess_from_edition,
    guess_from_roads,
    publish_editions,
    withheld,
)
from privacy.city import HEIDELBERG as HEIDELBERG_DEG
from privacy.city import City
from privacy.homes import name_homes
from privacy.picture import draw
from privacy.scoring import DOOR_M, HOME_M, Share, difference, right_drives, right_homes, share
from privacy.service import Server
from privacy.town import make_town

OWNERS = 3
"""The service's k."""
LOOKED_AT = (3, 5, 10)
QUICK = {
    "live": 30,
    "owners": 40,
    "drives": 30,
    "editions": 2,
    "removals": 1,
    "window": (8.665, 49.39, 8.715, 49.418),
}
AT_ONCE = 2
BEYOND = {"editions": "last", "of 3": "last, of 3"}
HOMES = {"homes": HOME_M, "doors": DOOR_M}
COLUMNS = {
    name: (name, "")
    for name in (
        "who",
        "drives %",
        "beyond",
        *(f"{what}{more}" for what in HOMES for more in (" %", " beyond")),
    )
}


def main() -> None:
    """Parse the command line, run, print."""
    parser = parser_of(__doc__)
    add_roads(parser)
    for name, number in (("owners", 200), ("drives", 400), ("editions", 4), ("removals", 3), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=number)
    parser.add_argument("--live", type=int, default=100, help="first drives that the live map is watched for")
    parser.add_argument(
        "--window", type=float, nargs=4, default=HEIDELBERG_DEG, metavar="DEG", help="W S E N"
    )
    parser.add_argument("--quick", action="store_true", help="a small town, to see whether it works")
    parser.add_argument("--plot", type=Path)
    args = parser.parse_args()
    if args.quick:
        vars(args).update(QUICK)
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with (
        tempfile.TemporaryDirectory(prefix="versant-bench-") as folder,
        EmbeddedPostgres(Path(folder) / "live") as live,
        EmbeddedPostgres(Path(folder) / "others") as others,
    ):
        # Changes are told when no older transaction of the server is open: the live map is followed undisturbed.
        figures = run(args, Server(live.url, Path(folder)), Server(others.url, Path(folder)))
    write_json(args.json, figures)


def run(args: argparse.Namespace, of_live: Server, server: Server) -> dict[str, Any]:
    """All figures, printed as well."""
    show_progress("roads")
    of_live.import_roads(args.roads)
    server.import_roads(args.roads)
    roads, ids = server.roads()
    city = City(roads, tuple(args.window))
    town = make_town(city, args.owners, args.drives, args.editions, args.seed)
    world = World(server, city, ids, town, args.editions, args.seed)
    watched = replace(world, town=replace(town, trips=town.trips[: args.live]), server=of_live)
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(AT_ONCE, mp_context=context) as pool:
        live = pool.submit(attack_live, replace(watched, ids=of_live.roads()[1]))
        removed = list(range(min(args.removals, args.owners)))
        usual = pool.submit(publish_editions, world, "editions", OWNERS - 1, removed, public_owners=OWNERS)
        lost = pool.submit(withheld, world, LOOKED_AT)
        bare = pool.submit(
            publish_editions, world, "bare", OWNERS - 1, public_owners=OWNERS, public_colluders=0
        )
        named: dict[str, Future[Names]] = {"live": live, "roads": pool.submit(guess_from_roads, world)}
        for name, guess, editions, least in (
            ("editions", "last", usual, OWNERS),
            ("of 3", "last, of 3", bare, 1),
        ):
            named[name] = pool.submit(attack_editions, world, editions.result(), least)
            named[guess] = pool.submit(guess_from_edition, world, editions.result().seen[-1])
        names = {name: future.result() for name, future in named.items()}
    show_progress("")
    if args.plot:
        shown = {name: names[name] for name in ("live", "editions")}
        draw(city, _true(watched), usual.result().seen[-1].told, shown, args.plot)
    return {
        "names": tell_names(world, watched, names),
        "withheld": tell_withheld(lost.result()),
        "removals": tell_removals(world, usual.result()),
    }


def tell_names(world: World, watched: World, names: dict[str, Names]) -> list[dict[str, Any]]:
    """Who named how much, and by how much more than the guesser; the live map is ``watched`` for a part of it."""
    rng, city, town = np.random.default_rng(world.seed), world.city, world.town
    worlds = {name: watched if name == "live" else world for name in names}
    drives = {name: right_drives(n.drives, _true(worlds[name]), city.length_m) for name, n in names.items()}
    homes = {
        (what, name): _right_homes(worlds[name], n, within_m)
        for what, within_m in HOMES.items()
        for name, n in names.items()
    }
    rows = []
    for name in ("live", "editions", "last", "of 3", "last, of 3", "roads"):
        row: dict[str, Any] = {"who": name}
        owner = np.array([trip.owner for trip in worlds[name].town.trips])
        row["drives %"] = share(drives[name], owner, rng)
        if name in BEYOND:
            row["beyond"] = difference(drives[name], drives[BEYOND[name]], owner, rng)
        for what in HOMES:
            right = homes[what, name]
            each = np.arange(len(right))
            row[f"{what} %"] = share(right, each, rng)
            if name in BEYOND:
                row[f"{what} beyond"] = difference(right, homes[what, BEYOND[name]], each, rng)
        rows.append(row)
    texts = [{column: str(row.get(column, "")) for column in COLUMNS} for row in rows]
    print(f"{len(town.owners)} owners, {len(town.trips)} drives of {_mean_km(world):.1f} km")
    print(text_table(texts, COLUMNS))
    return [{k: vars(v) if isinstance(v, Share) else v for k, v in row.items()} for row in rows]


def tell_withheld(shares: Sequence[tuple[int, int, float, float]]) -> list[dict[str, float]]:
    """What is lost."""
    columns = {
        "k": ("k", "g"),
        "needed": ("owners needed", "g"),
        "segments": ("segments unseen %", ".1f"),
        "length": ("length unseen %", ".1f"),
    }
    rows = [
        {"k": k, "needed": n, "segments": 100 * float(s), "length": 100 * float(m)} for k, n, s, m in shares
    ]
    print(text_table(rows, columns))
    return rows


def tell_removals(world: World, editions: Editions) -> list[dict[str, float]]:
    """How much of what an owner drove the attacker names after the owner's removal, and how much of that is right."""
    city, rows = world.city, []
    for taken in editions.removals:
        trips = [trip.rows for trip in world.town.trips if trip.owner == taken.owner]
        mine = np.unique(np.concatenate([*trips, np.empty(0, np.int64)]))
        right = np.intersect1d(taken.named, mine)
        rows.append(
            {
                "named_km": city.metres(taken.named) / 1000,
                "right": 100 * city.metres(right) / max(city.metres(taken.named), 1e-9),
                "found": 100 * city.metres(right) / max(city.metres(mine), 1e-9),
                "gone_km": city.metres(taken.gone) / 1000,
            }
        )
    columns = {
        "named_km": ("named after removal km", ".1f"),
        "right": ("of it right %", ".0f"),
        "found": ("of the owner's roads %", ".0f"),
        "gone_km": ("unknown since km", ".1f"),
    }
    print(text_table(rows, columns))
    return rows


def _right_homes(world: World, names: Names, within_m: float) -> Any:
    """Of those who drove at all."""
    true_m = world.town.homes_m[np.unique([trip.owner for trip in world.town.trips])]
    return right_homes(name_homes(world.city, names.homes, len(true_m), within_m), true_m, within_m)


def _true(world: World) -> list[Any]:
    return [np.unique(trip.rows) for trip in world.town.trips]


def _mean_km(world: World) -> float:
    return float(np.mean([world.city.metres(rows) for rows in _true(world)])) / 1000


if __name__ == "__main__":
    main()
