"""Says in sentences which navigation data a log lacks, so that a driver knows what file to add."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np

from fusion.arrays import nearest
from fusion.gnss.orbits.satellites import LIMIT_S
from fusion.messages import joined, say
from fusion.signals import GLONASS, SBAS, WEEK_S, Navigation, Signals, unix_from_gps
from fusion.types import Floats

NAMES = ("GPS", "GLONASS", "Galileo", "BeiDou", "QZSS", "SBAS")
ROLL_OVER_S = 1024 * WEEK_S
"""After so long, week numbers of ten bits begin anew."""
_NEAR_S = 14 * 86_400.0


def navigation_warnings(signals: Signals, navigation: Navigation) -> list[str]:
    """A sentence for all systems without any record, and one for each whose records are of other times.

    Augmentation satellites are passed over: what they send for ranging is not read.
    """
    present = [system for system in np.unique(signals.system).tolist() if system != SBAS]
    toes = {system: _toe_s(navigation, system) for system in present}
    sentences: list[str] = []
    without = [system for system in present if not len(toes[system])]
    if without and len(without) == len(present):
        sentences.append(say("gnss.no_navigation", days=_days(signals.gps_s)))
    elif without:
        rows = int(np.isin(signals.system, without).sum())
        names = " and ".join(NAMES[system] for system in without)
        sentences.append(say("gnss.no_navigation_of", names=names, n=rows))
    for system in present:
        if system not in without and not _meets(signals.gps_s, toes[system], LIMIT_S[system]):
            sentences.append(_of_another_day(NAMES[system], toes[system], signals.gps_s))
    return sentences


def _toe_s(navigation: Navigation, system: int) -> Floats:
    """Reference times of a system's records."""
    if system == GLONASS:
        return navigation.glonass.toe_s
    return np.asarray(navigation.kepler.toe_s[navigation.kepler.system == system])


def _meets(gps_s: Floats, toe_s: Floats, limit_s: float) -> bool:
    """Whether any record serves any epoch."""
    toes = np.sort(toe_s)
    return bool(np.any(np.abs(gps_s - toes[nearest(toes, gps_s)]) <= limit_s))


def _of_another_day(name: str, toe_s: Floats, gps_s: Floats) -> str:
    sentence = say("gnss.other_day", name=name, days=_days(toe_s), log_days=_days(gps_s))
    apart = float(np.median(gps_s) - np.median(toe_s))
    eras = round(apart / ROLL_OVER_S)
    if eras and abs(apart - eras * ROLL_OVER_S) < _NEAR_S:
        return joined([sentence, say("gnss.weeks_apart", n=abs(eras) * 1024)])
    return sentence


def _days(gps_s: Floats) -> str:
    """``2023-11-07``, or the first and the last with the time of day where they are of one day and far apart."""
    ends = [datetime.fromtimestamp(t, UTC) for t in unix_from_gps(np.array([np.min(gps_s), np.max(gps_s)]))]
    first, last = (f"{end:%Y-%m-%d}" for end in ends)
    return first if first == last else say("from_to", first=first, last=last)
