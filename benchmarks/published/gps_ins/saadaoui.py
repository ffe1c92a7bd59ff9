"""The simulated experiments of Saadaoui 2011, chapter 4: linear, turning, an outage of ours, and the printed forms.

A drive of 150 s at one epoch a second: speed a random walk up to 50 m/s (the thesis prints "5 m/s (180 km/h)"), the
heading constant or a random walk, both read by the INS with Gaussian noise, so that a step is off by about the 0.5 m
of Q; GPS errs by 15 m per axis. The filters are those of the methods, at the thesis's settings: every fix is taken,
no error hangs together. Errors are distances in the plane after the first 30 s, unless a row says otherwise; the
thesis draws them per axis and over time, and states no number of runs.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from fusion.filters.unscented import Unscented
from fusion.published.gps_ins.filter import DriveReadings, Filtered, Settings
from fusion.published.gps_ins.filter import run as run_filter
from fusion.published.gps_ins.models import ExtendedModel, KalmanModel, Model, UnscentedModel
from fusion.types import Floats, Progress
from published.rows import Row

STEPS = 150
SETTLED_S = 30
OUTAGE = (80, 120)
GPS_SIGMA_M = 15.0
SPEED_SIGMA_MPS = 0.3
HEADING_SIGMA_RAD = 0.02
TURN_RAD = 0.05

COMMAND = Settings(heading="command", min_speed_mps=0.0)
MEASURED = Settings(heading="measurement", heading_walk_rad=TURN_RAD, min_speed_mps=0.0)
OVERWRITTEN = replace(MEASURED, heading="overwrite")
KEPT = replace(OVERWRITTEN, heading_reset=False)

KF, EKF = KalmanModel(), ExtendedModel()
UKF = UnscentedModel(Unscented(1e-3, 2.0, -1.0))

LINEAR = "Saadaoui 2011, constant heading (figures 4.1, 4.2, 4.7)"
TURNING = "Saadaoui 2011, turning (figures 4.3 to 4.6, 4.8)"
LOST = "Saadaoui 2011, turning, 40 s without GPS (ours; the thesis has no outage)"
PRINTED = "Saadaoui 2011, turning, the printed forms (ours; the thesis reports no such errors)"


@dataclass(frozen=True)
class Truth:
    """A simulated drive and where the vehicle was, shape (n,)."""

    drive: DriveReadings
    x_m: Floats
    y_m: Floats

    def apart(self, x_m: Floats, y_m: Floats) -> Floats:
        """Distances from the truth in the plane."""
        return np.hypot(x_m - self.x_m, y_m - self.y_m)

    def on_axis(self, x_m: Floats, y_m: Floats) -> float:
        """The largest error on one axis after settling."""
        off = np.abs([x_m - self.x_m, y_m - self.y_m])
        return float(off[:, SETTLED_S:].max())


def simulate(seed: int, turn_rad: float) -> Truth:
    """A drive; ``turn_rad`` is the heading's random walk per step."""
    rng = np.random.default_rng([seed, 2011, int(turn_rad > 0)])
    n = STEPS + 1
    speed = np.clip(25.0 + np.cumsum(rng.normal(size=n)), 0.0, 50.0)
    heading = rng.uniform(-np.pi, np.pi) + turn_rad * np.cumsum(rng.normal(size=n))
    x = np.concatenate([[0.0], np.cumsum(speed * np.cos(heading))[:-1]])
    y = np.concatenate([[0.0], np.cumsum(speed * np.sin(heading))[:-1]])
    drive = DriveReadings(
        time_s=np.arange(n, dtype=np.float64),
        x_m=x + GPS_SIGMA_M * rng.normal(size=n),
        y_m=y + GPS_SIGMA_M * rng.normal(size=n),
        fix_sigma_m=np.full(n, GPS_SIGMA_M),
        speed_mps=speed + SPEED_SIGMA_MPS * rng.normal(size=n),
        heading_rad=heading + HEADING_SIGMA_RAD * rng.normal(size=n),
        heading_sigma_rad=np.full(n, HEADING_SIGMA_RAD),
        spread_m=np.zeros(n),
        restart=np.arange(n) == 0,
    )
    return Truth(drive, x, y)


@dataclass
class Table:
    """Rows that grow by one value a seed."""

    rows: dict[tuple[str, str], Row] = field(default_factory=dict)

    def add(
        self, experiment: str, quantity: str, unit: str, published: str, value: float, note: str = ""
    ) -> None:
        """One seed's value of a quantity."""
        empty = Row(experiment, quantity, unit, published, [], note)
        self.rows.setdefault((experiment, quantity), empty).ours.append(float(value))


def run(seeds: int, progress: Progress) -> list[Row]:
    """Every experiment over seeds 0 .. ``seeds`` - 1; ``progress`` hears a name and the share done."""
    table = Table()
    for seed in range(seeds):
        progress("saadaoui", seed / seeds)
        linear(table, simulate(seed, 0.0))
        turning = simulate(seed, TURN_RAD)
        turn(table, turning)
        lose(table, turning)
        print_forms(table, turning)
    progress("saadaoui", 1.0)
    order = (LINEAR, TURNING, LOST, PRINTED)
    return sorted(table.rows.values(), key=lambda row: order.index(row.experiment))


def settled(truth: Truth, filtered: Filtered) -> float:
    """Mean error of a filter after settling."""
    return float(truth.apart(*filtered.mean[:, :2].T)[SETTLED_S:].mean())


def gps_alone(table: Table, experiment: str, truth: Truth, largest: str) -> float:
    """The rows of the raw fixes; returns their mean error."""
    x, y = truth.drive.x_m, truth.drive.y_m
    mean = float(truth.apart(x, y)[SETTLED_S:].mean())
    table.add(experiment, "GPS alone, mean error", "m", "about 18", mean)
    note = "Gaussian noise of 15 m has its mean in the plane at 18.8 m, and a largest value beyond the published one."
    table.add(experiment, "GPS alone, largest error on an axis", "m", largest, truth.on_axis(x, y), note)
    return mean


def one_filter(
    table: Table, experiment: str, name: str, truth: Truth, filtered: Filtered, published: tuple[str, str]
) -> float:
    """The rows of one filter: mean, and largest on an axis; returns the mean."""
    mean = settled(truth, filtered)
    table.add(experiment, f"{name}, mean error", "m", published[0], mean)
    largest = truth.on_axis(*filtered.mean[:, :2].T)
    table.add(experiment, f"{name}, largest error on an axis", "m", published[1], largest)
    return mean


def linear(table: Table, truth: Truth) -> None:
    """E1 and E5: the heading is constant, and a command for all three."""
    raw = gps_alone(table, LINEAR, truth, "up to 30")
    kf, ekf, ukf = (run_filter(truth.drive, model, COMMAND) for model in (KF, EKF, UKF))
    mean = one_filter(table, LINEAR, "KF", truth, kf, ("4 to 5", "peaks of 7"))
    table.add(LINEAR, "KF over GPS alone, mean error", "", "4 to 5 of 18", mean / raw)
    for name, other in (("EKF", ekf), ("UKF", ukf)):
        apart = np.abs(other.mean - kf.mean).max()
        table.add(LINEAR, f"{name} from KF, largest difference", "m", "almost equal", apart)


def turn(table: Table, truth: Truth) -> None:
    """E2 to E4 and E6: the heading is the third state and measured by the INS."""
    raw = gps_alone(table, TURNING, truth, "up to 35")
    kf = run_filter(truth.drive, KF, COMMAND)
    table.add(TURNING, "KF (heading as command), mean error", "m", "", settled(truth, kf))
    ekf, ukf = (run_filter(truth.drive, model, MEASURED) for model in (EKF, UKF))
    mean = one_filter(table, TURNING, "EKF", truth, ekf, ("", "does not exceed 10"))
    table.add(TURNING, "EKF over GPS alone, mean error", "", "1/3 to 1/2", mean / raw)
    other = one_filter(table, TURNING, "UKF", truth, ukf, ("", "generally up to 10"))
    table.add(TURNING, "UKF over GPS alone, mean error", "", "", other / raw)
    note = "Its sign depends on the drive; the thesis shows one."
    table.add(
        TURNING, "EKF minus UKF, mean error", "cm", "centimetres, EKF better", 100 * (mean - other), note
    )
    apart = np.hypot(*(ekf.mean - ukf.mean)[:, :2].T).max()
    table.add(TURNING, "EKF from UKF, largest distance", "m", "a metre or less", apart)


def lose(table: Table, truth: Truth) -> None:
    """An outage: speed and heading alone."""
    first, end = OUTAGE
    lost = (truth.drive.time_s >= first) & (truth.drive.time_s < end)
    x, y = (np.where(lost, np.nan, fix) for fix in (truth.drive.x_m, truth.drive.y_m))
    drive = replace(truth.drive, x_m=x, y_m=y)
    for name, model, settings in (("KF", KF, COMMAND), ("EKF", EKF, MEASURED), ("UKF", UKF, MEASURED)):
        filtered = run_filter(drive, model, settings)
        error = truth.apart(*filtered.mean[:, :2].T)
        table.add(LOST, f"{name}, error at its end", "m", "", error[end - 1])
        table.add(LOST, f"{name}, stated sigma at its end", "m", "", filtered.h_sigma_m[end - 1])
    way = float(truth.drive.speed_mps[first:end].sum())
    table.add(LOST, "way driven in it", "m", "", way)


def print_forms(table: Table, truth: Truth) -> None:
    """Each misprint for itself, the rest as corrected."""
    first = truth.drive.time_s == 0
    # What is left of the heading where only the fixes correct it, as section 4.3.2 prints Z and H.
    blind = replace(truth.drive, heading_rad=np.where(first, truth.drive.heading_rad, np.nan))
    printed_jacobian = ExtendedModel(printed_jacobian=True)
    printed_alpha = UnscentedModel(Unscented(1e3, 2.0, -1.0))
    undrawn = UnscentedModel(Unscented(1e-3, 2.0, -1.0), late_noise=True)
    forms: list[tuple[str, Model, Settings, DriveReadings]] = [
        ("KF, command u = [v, heading]", KalmanModel(printed=True), COMMAND, truth.drive),
        ("EKF, innovation without Z", ExtendedModel(printed_innovation=True), OVERWRITTEN, truth.drive),
        ("EKF, heading from the fixes alone", EKF, MEASURED, blind),
        ("the same, printed Jacobian", printed_jacobian, MEASURED, blind),
        ("EKF, heading overwritten, printed Jacobian", printed_jacobian, OVERWRITTEN, truth.drive),
        ("EKF, heading overwritten, variance kept", EKF, KEPT, truth.drive),
        ("UKF, heading from the fixes alone", UKF, MEASURED, blind),
        ("the same, alpha = 1e3", printed_alpha, MEASURED, blind),
        ("UKF, heading measured, alpha = 1e3", printed_alpha, MEASURED, truth.drive),
        ("UKF, heading measured, points not redrawn", undrawn, MEASURED, truth.drive),
        ("UKF, heading overwritten, variance kept", UKF, KEPT, truth.drive),
    ]
    for name, model, settings, drive in forms:
        table.add(PRINTED, f"{name}: mean error", "m", "", settled(truth, run_filter(drive, model, settings)))
