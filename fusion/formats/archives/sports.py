"""What people did while a file was recorded, by the words of their program, in whatever language; and what is on roads.

Programs have their own words, and so have languages: "EBikeRide", "Radfahrt", "indoor_cycling". So a word is known by
its stem. What nobody knows counts as told by nobody.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

ROADS, ON_ROADS = "roads", frozenset({"cycling", "driving", "motorcycling"})
"""What goes on wheels and by roads, in one word. Who runs or walks goes by paths and pavements beside them."""

_STEMS: tuple[tuple[str, str], ...] = (
    (
        "indoors",
        r"indoor|virtual|treadmill|laufband|\bspin|trainer|elliptical|stair|rameur|yoga|pilates|strength|weight|crossfit"
        r"|hiit|workout|fitness|\bgym|cardio|krafttraining|virtuel|intern",
    ),
    ("riding", r"horse|\breit|equit|equest"),
    (
        "swimming",
        r"swim|schwimm|natation|\bnage|nuoto|nataci|nata[cç]|zwem|open water|snorkel|diving|tauchen",
    ),
    (
        "on water",
        r"rowing|ruder|kayak|kajak|cano|paddl|sail|segel|surf|boat|raft|kite|water|aviron|voile|\bremo\b|vela",
    ),
    ("on skates", r"skat|inline|roller|patin"),
    ("on snow", r"\bski|snow|schnee|langlauf|schlitten|sled|neige|esqu[ií]"),
    (
        "in the air",
        r"\bfly|flying|fliegen|glid|wingsuit|parachut|parapent|sky div|drone|aviation|jumpmaster|vol libre",
    ),
    ("motorcycling", r"motor ?cycl|motor ?rad|motor ?bik|\bmoto|\batv\b"),
    (
        "cycling",
        r"cycl|bik|cicl|bici|fiets|wielren|fahrrad|\brad|v[eé]lo|\bride\b|\bmtb\b|\bbmx\b|gravel|randonn[eé]e cyc",
    ),
    ("driving", r"driv|\bcar\b|\bauto\b|autofahr|\bpkw\b|\bkfz\b|vehicle|truck|\bbus\b|taxi|voiture|coche"),
    ("jogging", r"\brun|jog|lauf|course (à|a) pied|corsa|carrera|hardlop|\btrail"),
    (
        "walking",
        r"walk|hik|\bwander|spazier|\bgeh|march[ea]|randonn|camin|wandel|senderis|escursion|trek|mountaineer"
        r"|bergsteig",
    ),
    (
        "another sport",
        r"golf|tennis|soccer|football|ball\b|hockey|cricket|climb|kletter|box|dance|tanz|rugby|racket",
    ),
)
"""The first that fits counts: a virtual ride is indoors."""
_NUMBERS = {
    "1": "cycling", "4": "walking", "9": "jogging", "10": "walking", "16": "swimming", "17": "indoors",
}  # fmt: skip
"""Strava once wrote its kinds of activities as numbers."""
_PATTERNS = tuple((name, re.compile(stems)) for name, stems in _STEMS)
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])|[_\-/,]+")

SPORTS = tuple(name for name, _ in _STEMS)
"""All that is told apart."""


def family(words: str) -> str:
    """Which of ``SPORTS`` a program's word for one is; empty where it is none that is known, as of "Other"."""
    words = words.strip()
    if words in _NUMBERS:
        return _NUMBERS[words]
    plain = _HUMP.sub(" ", words).lower()
    return next((name for name, stems in _PATTERNS if stems.search(plain)), "")


def chosen(names: Iterable[str]) -> frozenset[str]:
    """Sports by words for them, or by ``ROADS``; ``ValueError`` with the first that is none."""
    found = set[str]()
    for name in names:
        if name == ROADS:
            found |= ON_ROADS
            continue
        if not (sport := name if name in SPORTS else family(name)):
            raise ValueError(name)
        found.add(sport)
    return frozenset(found)
