"""Words of many programs and languages for what people do; what is on roads."""

from __future__ import annotations

import pytest

from fusion.formats.archives.sports import ON_ROADS, SPORTS, chosen, family

WORDS = {
    "cycling": "Ride EBikeRide MountainBikeRide GravelRide Biking road_biking racebike touringbicycle cycling Radfahrt "
    "Fahrrad Vélo Ciclismo Bicicletta fietsen e_biking 1 BIKING",
    "driving": "driving Autofahren in_vehicle car",
    "motorcycling": "motorcycling Motorrad motor_bike",
    "jogging": "Run TrailRun Running Lauf jogging Corsa Carrera 9",
    "walking": "Walk Hike hiking Wanderung Spaziergang Gehen randonnée walking senderismo",
    "swimming": "Swim Schwimmen Natation lap_swimming open_water Nuoto 16",
    "indoors": "VirtualRide virtual_activity treadmill indoor_cycling Workout WeightTraining 17",
    "on snow": "AlpineSki Snowboard Langlauf NordicSki",
    "on water": "Rowing Kayaking Sail StandUpPaddling Rudern",
    "": "Other generic unknown Sonstiges",
}


@pytest.mark.parametrize(("sport", "words"), [(s, w) for s, words in WORDS.items() for w in words.split()])
def test_a_word_is_known_by_its_stem(sport: str, words: str) -> None:
    assert family(words) == sport


def test_sports_are_chosen_by_any_word() -> None:
    assert chosen(["Run", "in the air"]) == {"jogging", "in the air"}
    assert set(SPORTS) > ON_ROADS
    assert all(family(sport) == sport for sport in ON_ROADS | {"jogging", "walking", "swimming"})
    with pytest.raises(ValueError, match="chess"):
        chosen(["chess"])
