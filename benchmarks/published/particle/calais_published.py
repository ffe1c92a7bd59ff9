"""What Al Assaad's thesis prints (tables 2.1 to 2.3, sections 2.4 and 3.5), and a sentence on each difference."""

from __future__ import annotations

from collections.abc import Mapping

Quantity = tuple[str, str, str]
"""Name, unit, what the thesis prints."""

_ALONE = ", beside GNSS alone"


def _axes(quantity: str, unit: str, std: tuple[str, ...], mean: tuple[str, ...] = ()) -> list[Quantity]:
    """Rows of standard deviations, each beside GNSS alone too, then of means, along east, north and up."""
    rows: list[Quantity] = []
    for axis, printed in zip("ENU", std, strict=True):
        rows += [(f"{quantity} {axis}, std{end}", unit, printed) for end in ("", _ALONE)]
    return rows + [
        (f"{quantity} {axis}, mean", unit, printed) for axis, printed in zip("ENU", mean, strict=False)
    ]


_ALTITUDE: list[Quantity] = [
    ("altitude, the filter's own sigma", "m", ""),
    ("altitude, best possible std", "m", ""),
]
_THREE_D: list[Quantity] = [
    ("3-D position error, std", "m", "0.90"),
    ("3-D position error, std" + _ALONE, "m", "0.90"),
    ("3-D position error, max", "m", "6"),
    ("3-D position error, max" + _ALONE, "m", "6"),
]
_MAP: list[Quantity] = [
    ("map-match rate", "%", "94.35"),
    ("matches on the segment driven", "%", ""),
    ("epochs resampled", "%", "57"),
    ("epochs resampled, threshold 0.1", "%", "57"),
]
_SLOPES: list[Quantity] = [
    ("segments with a slope", "", "46"),
    ("driven segments with a slope", "%", "about half"),
    ("most epochs on a segment", "", "25"),
    ("steepest slope down", "%", "-2.6"),
    ("steepest slope up", "%", "4.7"),
    ("slope error, RMS", "%", ""),
    ("slope errors within 1.96 sigma", "%", ""),
]

CHAPTER_2: list[Quantity] = [
    *_axes("acceleration", "m/s2", ("0.34", "0.32", "0.20"), ("0.013", "0.038", "-0.0021")),
    *_axes("velocity", "m/s", ("1.27", "0.94", "0.30"), ("0.069", "0.094", "-0.0046")),
    *_axes("position", "m", ("2.8", "1.9", "0.6"), ("0.24", "0.32", "-0.11")),
    *_ALTITUDE,
    *_THREE_D,
    ("yaw, std", "rad", "0.14"),
    ("yaw, mean", "rad", "0.010"),
    ("pitch, std", "rad", "0.05"),
    ("pitch, mean", "rad", "-0.0052"),
    *_MAP,
]
CHAPTER_3: list[Quantity] = [
    *_axes("acceleration", "m/s2", ("-", "-", "-")),
    *_axes("velocity", "m/s", ("-", "-", "-")),
    *_axes("position", "m", ("-", "-", "0.30")),
    ("position U, std, receiver m8", "m", "0.30"),
    ("position U, std, receiver m8" + _ALONE, "m", "0.30"),
    *_ALTITUDE,
    ("altitude, best possible std, receiver m8", "m", ""),
    ("yaw, std", "rad", "-"),
    ("pitch, std", "rad", "0.05 (ch. 2)"),
    ("map-match rate", "%", "94.35 (ch. 2)"),
    *_MAP[1:3],
    *_SLOPES,
]
UNSCENTED: list[Quantity] = [
    *_axes("velocity", "m/s", ("-", "-", "-")),
    *_axes("position", "m", ("-", "-", "-")),
    ("yaw, std", "rad", "-"),
    ("pitch, std", "rad", "-"),
    ("map-match rate", "%", "-"),
    _MAP[1],
    *_SLOPES,
]

CASE_2, CASE_3, CASE_3_DOPPLER, CASE_UKF = "chapter 2", "chapter 3", "chapter 3 with Doppler", "ukf-dem"

_ACCELEROMETER = (
    "Against the truth the error is the accelerometer's own noise of 0.05 m/s2; the thesis compares with a "
    "reference that has no accelerometer."
)
_LATE = (
    "The reference learns of a change of speed from positions alone, seconds late, and nearly all of the "
    "difference is its error; how late depends on its process noise, which the thesis does not state."
)
_MEANS = (
    "Over one drive a mean is what is left of slow errors, and its sign is chance; ours is smaller than the "
    "printed one."
)
_ACC_BIAS = (
    "Each axis of our accelerometer has a bias of 0.05 m/s2 (one sigma), and chapter 2 has nothing to hold its "
    "climb against; without the bias these means vanish. The thesis calibrated its sensor."
)
_VELOCITY = (
    "Without Doppler velocity follows from positions and acceleration. The printed figure is a difference from "
    "a reference that has no acceleration either, at process noises that the thesis does not state."
)
_HORIZONTAL = (
    "The map of the scene is true to half a metre, the lane within two, and GNSS errs by 2 m in the plane: "
    "there is less to disagree about than the thesis had between its receiver and OpenStreetMap."
)
_BIAS = (
    "The receiver's height has a bias of 2.5 m (one sigma) for a whole drive, and the estimate follows it."
)
_MEAN_BIAS = "GNSS errors that last for minutes, of up to 2 m, stay in the mean."
_ALTITUDE_2 = (
    "Slow GNSS errors, which the thesis's reference shares, and ASTER's bumps remain against the truth; beside "
    "GNSS alone, which is what the thesis prints, ours is about as small as its."
)
_ALTITUDE_3 = (
    "Slow GNSS errors remain against the truth. Beside positions alone ours is no closer than in chapter 2, "
    "for pitch takes the estimate away from a reference that knows climb only from heights; beside a reference "
    "with velocity it is as printed."
)
_ALTITUDE_3_DOPPLER = (
    "Beside GNSS alone, the thesis's measure, it is as printed and below 0.6 m on every drive. Against the "
    "truth the median drive errs by about as much as a filter that knows all noises exactly (the row best "
    "possible): a height that is off by 1.2 m for a minute cannot be told from a hill."
)
_HARSH = (
    "Profile m8 errs by 3 m with a time constant of two minutes: the error against the truth grows with the "
    "receiver's, the difference from GNSS alone far less."
)
_YAW = (
    "Standstill, where a heading is chance, is left out here; the thesis does not say over which epochs it "
    "counts."
)
_PITCH = (
    "Standstill, where vz / v is any number, is left out here, and the true climb is known; the thesis's comes "
    "from GNSS heights."
)
_RATE = (
    "Every road that is driven is in our map, and none is off by more than its stated accuracy; the thesis "
    "does not say where its epochs without a match lie."
)
_RESAMPLED = (
    "With N_eff below 2/3 of the particles nearly every epoch is resampled, with 0.1 a third; the thesis names "
    "both thresholds, and its share lies between."
)
_STEEPEST = "Another scene: the true slopes of segments with four epochs and more reach from about -4 to 5 %."
_UNSCENTED = (
    "The thesis cites this system without figures (its reference [29]); the rows stand for comparison."
)


def _notes() -> dict[tuple[str, str], str]:
    """Sentences by case and quantity."""
    second = {
        **dict.fromkeys((f"acceleration {a}, std" for a in "ENU"), _ACCELEROMETER),
        **dict.fromkeys((f"acceleration {a}, std{_ALONE}" for a in "ENU"), _LATE),
        **dict.fromkeys((f"{q} {a}, mean" for q in ("acceleration", "velocity") for a in "EN"), _MEANS),
        **dict.fromkeys(("acceleration U, mean", "velocity U, mean", "pitch, mean"), _ACC_BIAS),
        **dict.fromkeys((f"velocity {a}, std" for a in "ENU"), _VELOCITY),
        **dict.fromkeys((f"position {a}, std" for a in "EN"), _HORIZONTAL),
        **dict.fromkeys((f"position {a}, mean" for a in "EN"), _MEAN_BIAS),
        "position U, std": _ALTITUDE_2,
        "position U, mean": _BIAS,
        "yaw, std": _YAW,
        "pitch, std": _PITCH,
        "map-match rate": _RATE,
        "epochs resampled": _RESAMPLED,
        "epochs resampled, threshold 0.1": _RESAMPLED,
    }
    third = {
        "pitch, std": _PITCH,
        "map-match rate": _RATE,
        "epochs resampled": _RESAMPLED,
        "steepest slope down": _STEEPEST,
        "steepest slope up": _STEEPEST,
    }
    doppler = {"position U, std": _ALTITUDE_3_DOPPLER, "position U, std, receiver m8": _HARSH}
    unscented = {"position U, std": _UNSCENTED}
    return {
        (case, quantity): note
        for case, notes in (
            (CASE_2, second),
            (CASE_3, {**third, "position U, std": _ALTITUDE_3}),
            (CASE_3_DOPPLER, {**third, **doppler}),
            (CASE_UKF, unscented),
        )
        for quantity, note in notes.items()
    }


NOTES: Mapping[tuple[str, str], str] = _notes()
