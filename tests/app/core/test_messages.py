"""The catalogues of messages: one key for each sentence, the same in every language, and what is made of them."""

from __future__ import annotations

import ast
import json
import re
import string
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from app.cli.methods import catalogue as listed_choices
from app.core.errors import BadQueryError, all_kinds
from app.core.messages import with_fault
from app.core.query import parse_bbox
from app.core.telemetry.logs import said_of_failure
from app.drives.batches.documents import BatchRequest
from app.exports.formats import SEGMENT_FORMATS
from app.map.items.cql import TEXT, parse_filter
from app.web import guides
from fusion.catalogue import METHODS, POSITIONINGS
from fusion.errors import EmptyLogError
from fusion.formats import FORMATS
from fusion.messages import (
    LANGUAGES,
    TERMS,
    Message,
    catalogue,
    joined,
    message_of,
    remarks_of,
    said,
    say,
    speaking,
    text_in,
    told,
    with_key,
    with_remarks,
)
from fusion.options import option_facts

REPOSITORY = Path(__file__).parents[3]
PARSERS = "usage."
"""Sentences of the parser of commands, which are found by their text (``app.cli.words.parser``)."""
KEYS = [key for key in catalogue("en") if key != TERMS]


@cache
def trees() -> list[tuple[str, ast.Module]]:
    """Every module of the library and of the service."""
    paths = [path for folder in ("fusion", "app") for path in sorted((REPOSITORY / folder).rglob("*.py"))]
    return [(str(path.relative_to(REPOSITORY)), ast.parse(path.read_text())) for path in paths]


def each_call() -> Iterator[tuple[str, ast.Call]]:
    """Every call, and where it stands."""
    for path, tree in trees():
        yield from ((path, node) for node in ast.walk(tree) if isinstance(node, ast.Call))


def calls() -> Iterator[tuple[str, str, set[str]]]:
    """Where a sentence is made by a key that stands there, the key, and the names of its parameters."""
    for path, call in each_call():
        by_key = isinstance(call.func, ast.Name) and call.func.id in {"say", "tell"}
        named = [one.arg for one in call.keywords]
        if by_key and isinstance(call.args[0], ast.Constant) and None not in named:
            yield f"{path}:{call.lineno}", call.args[0].value, set(map(str, named))


def names(template: str | dict[str, str]) -> set[str]:
    """What a template asks for."""
    forms = [template] if isinstance(template, str) else list(template.values())
    return {name for form in forms for _, name, _, _ in string.Formatter().parse(form) if name}


def test_each_sentence_of_the_code_is_in_the_catalogues_with_its_parameters() -> None:
    english = catalogue("en")
    wrong = [
        (place, key)
        for place, key, parameters in calls()
        if key not in english or not names(english[key]) <= parameters
    ]
    assert wrong == []


def test_the_languages_have_the_same_keys_with_the_same_parameters() -> None:
    english = catalogue("en")
    for language in LANGUAGES[1:]:
        other = catalogue(language)
        lacking = sorted(set(english) ^ set(other))
        assert lacking == [], f"fusion/catalogues or app/core/messages: add these keys to {language}.json"
        assert {key: names(other[key]) ^ names(english[key]) for key in KEYS} == {key: set() for key in KEYS}


def test_no_key_is_in_two_catalogues_nor_unused() -> None:
    folders = ("fusion/catalogues", "app/core/messages", "app/core/messages/commands")
    files = [REPOSITORY / folder / "en.json" for folder in folders]
    keys = [key for file in files for key in json.loads(file.read_text()) if key != TERMS]
    assert sorted(keys) == sorted(set(keys))
    nodes = [node for _, tree in trees() for node in ast.walk(tree)]
    written = {node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str)}
    made = {pattern(node) for node in nodes if isinstance(node, ast.JoinedStr)}
    made = {one for one in made if re.match(r"[a-z]+\\\.", one)}
    kinds = {f"problem.{slug}" for slug in all_kinds()} | {key for key in keys if key.startswith(PARSERS)}
    idle = [
        key for key in keys if key not in written | kinds and not any(re.fullmatch(one, key) for one in made)
    ]
    assert idle == []


def pattern(text: ast.JoinedStr) -> str:
    """What an f-string may come to, as a regular expression."""
    parts = [
        re.escape(str(one.value)) if isinstance(one, ast.Constant) else r"[a-z_]+" for one in text.values
    ]
    return "".join(parts)


def stages_of_operations() -> Iterator[str]:
    """What long work on the map says that it is doing: the page of operators shows it."""
    for path, tree in trees():
        if not path.startswith(("app/roads/", "app/terrain/", "app/operations/", "app/network/")):
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and "progress" in ast.unparse(node.func):
                named = node.args[:1]
            elif isinstance(node, ast.Yield) and isinstance(node.value, ast.Tuple):
                named = node.value.elts[:1]
            else:
                continue
            yield from (str(one.value) for one in named if isinstance(one, ast.Constant))


def test_reasons_for_leaving_something_out_and_other_fixed_words_are_in_every_language() -> None:
    fixed = {kind.description for kind in FORMATS.values()} | {kind.title for kind in all_kinds().values()}
    for _, call in each_call():
        if isinstance(call.func, ast.Attribute) and call.func.attr == "skip":
            fixed |= {one.value for one in call.args[:1] if isinstance(one, ast.Constant)}
    fixed |= set(stages_of_operations())
    for section in guides.sections():
        fixed |= {section.title, *(one.title for name, _ in section.pages if (one := guides.guide(name)))}
        fixed |= {sentence for _, sentence in section.pages}
    lacking = sorted(fixed - set(catalogue("de")[TERMS]))
    assert lacking == [], "add these under terms of fusion/catalogues/de.json or app/core/messages/de.json"


def test_what_is_to_be_chosen_is_described_in_every_language() -> None:
    described: set[str] = set()
    for choice in (*METHODS.values(), *POSITIONINGS.values()):
        described |= {choice.description, choice.source, *getattr(choice, "needs", ())}
        described |= {one.description for one in option_facts(choice.options_model).values()}
    described |= {one.description for one in SEGMENT_FORMATS.values()}
    for name, listed in listed_choices().items():
        if isinstance(listed, dict) and name != "methods":
            described |= {one for one in listed.values() if not getattr(one, "key", "")}
    assert described - set(catalogue("de")[TERMS]) == set()


def sentences_without_key(made_by: re.Pattern[str], folders: tuple[str, ...]) -> list[str]:
    """Where a call of that name is given a sentence that no catalogue has."""
    return [
        f"{path}:{call.lineno}"
        for path, call in each_call()
        if path.startswith(folders) and made_by.fullmatch(ast.unparse(call.func))
        for one in call.args
        if isinstance(one, ast.Constant | ast.JoinedStr) and SENTENCE.search(fixed_part(one))
    ]


def fixed_part(text: ast.Constant | ast.JoinedStr) -> str:
    parts = text.values if isinstance(text, ast.JoinedStr) else [text]
    return "".join(str(one.value) if isinstance(one, ast.Constant) else "0" for one in parts)


SENTENCE = re.compile(r"[A-Za-z]{2,}[,;:]? [a-z]")
OWN_ERROR = re.compile(
    r"(?!psycopg\.|(?:Value|Runtime|Type|Assertion|Attribute|OS|IsADirectory|FileNotFound|Proj|np.linalg.LinAlg)Error)[\w.]*(?:Error|\.about)"
)
FAULTS = {"app/core/db.py", "app/map/tiles/tiles.py"}
"""Their errors are told to programs, not to people."""


def test_each_refusal_is_said_by_a_key() -> None:
    wrong = sentences_without_key(OWN_ERROR, ("app/", "fusion/"))
    assert [one for one in wrong if one.partition(":")[0] not in FAULTS] == []


def test_each_note_on_a_file_and_each_thing_that_needs_a_person_is_said_by_a_key() -> None:
    said_by_key = re.compile(r"(?:source|self|console)\.note|_row|_counted|console\.complain|typer\.\w+")
    assert sentences_without_key(said_by_key, ("app/",)) == []


def test_a_message_is_its_english_text_and_said_in_another_language() -> None:
    first = say("fault.at", place=say("place.line", n=7), fault=say("fault.latitude", lat_deg=91.25))
    message = say("log.skipped", n=3, reason="latitude out of range", first=first)
    assert message == (
        "Skipped 3 x latitude out of range; the first: line 7: lat_deg is 91.25, outside -90..90."
    )
    german = (
        "3 × ausgelassen: Breite außerhalb des Bereichs; zuerst: Zeile 7: "
        "lat_deg ist 91,25, außerhalb von -90..90."
    )
    assert text_in("de", message) == german
    assert text_in("en", message) == message
    again = with_key(str(message), json.loads(json.dumps(said(message))))
    assert (again, text_in("de", again)) == (message, german)


def test_messages_go_through_errors_and_reports_with_their_keys() -> None:
    error = EmptyLogError(say("log.no_file"))
    assert said(message_of(error)) == {"key": "log.no_file", "parameters": {}}
    both = joined([say("drive.no_ground"), "", "Mine."])
    report = with_remarks({"epochs": 3}, [both, "Nobody's."])
    assert report["warnings_said"][1] is None
    stored = json.loads(json.dumps(report))
    assert stored["warnings"] == [f"{say('drive.no_ground')} Mine.", "Nobody's."]
    again = remarks_of(stored)
    assert text_in("de", again[0]).endswith("konnte nicht verwendet werden. Mine.")
    assert remarks_of({"warnings": ["Of an older version."]}) == ["Of an older version."]


@pytest.mark.parametrize(
    "text", ["Plain.", Message("Plain."), Message("Plain.", "of.another_version", {"n": 1})]
)
def test_what_has_no_words_stays_as_it_is(text: str) -> None:
    assert text_in("de", text) == "Plain."


def test_a_failure_is_stored_without_places() -> None:
    reason = say("fault.at", place="8.4612345 or so", fault=say("fault.latitude", lat_deg=91.2345678))
    stored: Any = said_of_failure(reason, None)
    assert stored["where"] is None
    text = json.dumps(stored)
    assert "8.46" not in text
    assert "91.2345" not in text
    assert text_in("de", with_key("", stored["reason"])).endswith(
        "lat_deg ist (entfernt), außerhalb von -90..90"
    )
    assert said_of_failure("Plain.", "line 3") is None


def test_refusals_of_filters_and_of_validators_are_said_in_german() -> None:
    with pytest.raises(BadQueryError) as refused:
        parse_filter("name = ", TEXT)
    german = text_in("de", message_of(refused.value))
    assert german.startswith("filter: er kann beim Zeichen 8 nicht gelesen werden, am Ende")
    with pytest.raises(BadQueryError) as refused:
        parse_bbox("1,2,x,4")
    german = text_in("de", message_of(refused.value))
    assert german == "bbox: 'x' ist keine Zahl. Schreiben Sie etwa bbox=8.46,48.95,8.50,48.99."
    with pytest.raises(ValidationError) as invalid:
        BatchRequest.model_validate({"dry_run": "perhaps"})
    (fault,) = invalid.value.errors()
    assert text_in("de", with_fault(fault["msg"], fault)) == "das muss true oder false sein"
    assert with_fault("Odd.", {"type": "of_a_later_version"}) == "Odd."


def test_figures_and_names_in_quotes_are_written_as_german_does() -> None:
    assert text_in("de", say("batch.removed", n=12345)).startswith("12.345 Fahrten")
    # A name that somebody gave is no word of ours, though it reads like one.
    assert text_in("de", say("query.no_query", name="method", names="queue")).startswith(
        "Es gibt keine Abfrage 'method'."
    )
    with speaking("de"):
        assert (told("bridge"), told(say("processing.split"))) == (
            "Brücke",
            "Teilen Sie die Aufzeichnung in kürzere Fahrten.",
        )
    assert told("bridge") == "bridge"
