"""Systems that Saadaoui 2011 surveys without equations, as far as it describes them: co-operation and relative GPS.

``Drawil`` (2.2.4): seven vehicles follow each other through streets, 40 m apart, each with a receiver of GPS and a
Kalman filter of its own (solver ``ekf``, of pseudoranges alone). The middle one uses the others in radio range, as
``fusion.published.positioning.cooperative`` says. In town fronts stand along most of the way, in the open along none of
it. The document has two figures for each and does not say of what.

``Redmill`` (2.2.6) and relative positioning (1.3.1, table 1.1): the filter of positions, speed and heading of chapter 4
over GPS whose error is shared with a base, and over the same GPS without it. The error lasts for half an hour; what is
the receiver's own is 1 m. Table 1.1 has 15 to 20 m for the ionosphere alone, and 2 to 3 m beside a base.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fusion.catalogue import SOLVERS
from fusion.frames import local_axes
from fusion.gnss.measurements import Aids, Solution
from fusion.gnss.reception import NLOS, THRESHOLDS_DBHZ, states_by_threshold
from fusion.published.canyon.drive import CanyonDrive, simulate_canyon
from fusion.published.canyon.radio import TOWN
from fusion.published.canyon.sky import synthetic_navigation
from fusion.published.gps_ins.filter import run as run_filter
from fusion.published.positioning.cooperative import Neighbours, contaminated, refined
from fusion.signals import GPS
from fusion.simulate.receiver.readings import gauss_markov
from fusion.types import Progress, no_progress
from published.gps_ins.saadaoui import EKF, MEASURED, SETTLED_S, STEPS, TURN_RAD, Table, simulate
from published.positioning.rouen import fronts_of_route, ride_along, winding_route
from published.rows import Row

VEHICLES, APART_M, RADIO_M = 7, 40.0, 300.0
"""One behind the other; the middle one is looked at. Radio between vehicles reaches 300 m in streets."""
RANGE_SIGMA_M = 1.0
"""Of a distance measured by radio or radar."""
SPOILED_SIGMA_M = 15.0
"""What a vehicle believes of its place along an axis while reflections spoil it: the noise of chapter 4."""
SPEED_MPS, EPOCHS = 12.0, 300
STREETS = {
    "open": {"open": 1.0},
    "town": {"open": 0.1, "residential": 0.3, "urban": 0.4, "dense": 0.2},
}
DRAWIL = "Drawil: vehicles that co-operate (2.2.4)"
REDMILL = "Redmill: DGPS and INS (2.2.6; table 1.1)"
PRINTED = {"open": "2.33 and 19.43", "town": "18.48 and 20.01"}
UNSAID = "The document does not say what the two figures of a row are."
SHARED_SIGMA_M, SHARED_TAU_S, OWN_SIGMA_M = 12.0, 1800.0, 1.0
"""Per axis: what satellites and air make of two receivers' places alike, and a receiver's own noise."""
BASE_AVERAGED_S = 60


def run(seeds: int, progress: Progress) -> list[Row]:
    """Every experiment over seeds 0 .. ``seeds`` - 1; ``progress`` hears a name and the share done."""
    table = Table()
    for seed in range(seeds):
        progress("surveyed", seed / seeds)
        for streets in STREETS:
            cooperate(table, seed, streets)
        by_base(table, seed)
    progress("surveyed", 1.0)
    return list(table.rows.values())


class Vehicle:
    """A vehicle's own estimate on a plane around its true places, and when reflections spoil it."""

    def __init__(self, canyon: CanyonDrive, seed: int) -> None:
        measured, solver = canyon.measurements(), SOLVERS["ekf"]
        measured = replace(measured, range_rate_mps=np.full(len(measured.satellite), np.nan))
        aids = Aids.none(len(measured))
        found: Solution = solver.solve(measured, aids, solver.options_model(), seed, no_progress)
        axes = local_axes(canyon.ride.position_m)
        off = np.einsum("nij,nj->ni", axes, found.position_m - canyon.ride.position_m)[:, :2]
        self.true_m = canyon.ride.local_m[:, :2]
        self.place_m = self.true_m + off
        own = (axes @ found.covariance[:, :3, :3] @ axes.transpose(0, 2, 1))[:, :2, :2]
        states = states_by_threshold(measured.cn0_dbhz, THRESHOLDS_DBHZ["u-blox"])
        self.spoiled = contaminated(states == NLOS, measured.first)
        self.covariance_m2 = own + np.where(self.spoiled, SPOILED_SIGMA_M**2, 0.0)[:, None, None] * np.eye(2)
        self.sigma_m = np.sqrt(np.trace(self.covariance_m2, axis1=1, axis2=2) / 2)


def cooperate(table: Table, seed: int, streets: str) -> None:
    """The middle vehicle alone, and with the others."""
    rng = np.random.default_rng([seed, 2008, len(streets)])
    route = winding_route(SPEED_MPS * EPOCHS + VEHICLES * APART_M + 50.0, rng)
    fronts = fronts_of_route(route, rng, STREETS[streets])
    lead = int(np.ceil(VEHICLES * APART_M / SPEED_MPS))
    ride = ride_along(route, EPOCHS + lead, SPEED_MPS)
    navigation = synthetic_navigation(float(ride.gps_s[0]), float(len(ride)), rng, (GPS,))
    vehicles = []
    for number in range(VEHICLES):
        first = round(number * APART_M / SPEED_MPS)
        there = ride.take(slice(first, first + EPOCHS))
        there = replace(there, time_s=ride.time_s[:EPOCHS])
        vehicles.append(Vehicle(simulate_canyon(there, fronts, TOWN, navigation, rng), seed))
    middle = VEHICLES // 2
    target, others = vehicles[middle], [v for k, v in enumerate(vehicles) if k != middle]
    known = np.isfinite(target.place_m).all(axis=1)
    place = target.place_m.copy()
    for k in np.flatnonzero(known & target.spoiled).tolist():
        near = [v for v in others if np.isfinite(v.place_m[k]).all()]
        away = np.array([np.linalg.norm(v.true_m[k] - target.true_m[k]) for v in near])
        near = [v for v, far in zip(near, away, strict=True) if far < RADIO_M]
        told = Neighbours(
            np.array([v.place_m[k] for v in near]),
            np.array([v.sigma_m[k] for v in near]),
            away[away < RADIO_M] + RANGE_SIGMA_M * rng.normal(size=len(near)),
            RANGE_SIGMA_M,
        )
        place[k] = refined(target.place_m[k], target.covariance_m2[k], told)
    for name, estimate in (("alone", target.place_m), ("with neighbours", place)):
        off = np.linalg.norm(estimate - target.true_m, axis=1)[known]
        table.add(DRAWIL, f"{streets}: {name}, mean error", "m", PRINTED[streets], off.mean(), UNSAID)
        table.add(DRAWIL, f"{streets}: {name}, largest error", "m", "-", off.max())
    table.add(DRAWIL, f"{streets}: epochs that reflections spoil", "%", "-", 100 * target.spoiled.mean())


def by_base(table: Table, seed: int) -> None:
    """The filter of chapter 4 over GPS alone, and over GPS that a base has corrected."""
    truth, rng = simulate(seed, TURN_RAD), np.random.default_rng([seed, 2006])
    n = STEPS + 1
    shared = np.array([gauss_markov(n, 1.0, SHARED_SIGMA_M, SHARED_TAU_S, rng) for _ in range(2)])
    own = OWN_SIGMA_M * rng.normal(size=(2, n))
    left = OWN_SIGMA_M / np.sqrt(BASE_AVERAGED_S) * rng.normal(size=(2, n))
    alone, corrected = shared + own, own + left
    for name, error, sigma_m, published in (
        ("GPS", alone, np.hypot(SHARED_SIGMA_M, OWN_SIGMA_M), "15 to 20 (ionosphere)"),
        ("DGPS", corrected, float(np.std(corrected)), "2 to 3 (ionosphere)"),
    ):
        x_m, y_m = truth.x_m + error[0], truth.y_m + error[1]
        drive = replace(truth.drive, x_m=x_m, y_m=y_m, fix_sigma_m=np.full(n, sigma_m))
        table.add(
            REDMILL, f"{name} alone, mean error", "m", published, truth.apart(x_m, y_m)[SETTLED_S:].mean()
        )
        filtered = run_filter(drive, EKF, MEASURED)
        off = truth.apart(*filtered.mean[:, :2].T)[SETTLED_S:]
        largest = "-" if name == "GPS" else "1.5 (skid pad), 2 (winding road)"
        table.add(REDMILL, f"{name} and INS, mean error", "m", "-", off.mean())
        table.add(REDMILL, f"{name} and INS, largest error", "m", largest, off.max())
