"""Sentences for people: each has a key and parameters, and its words in one catalogue per language.

``say("gpx.no_times", n=12)`` is the English sentence, a ``str`` that also knows its key and parameters
(``Message``), so that whoever shows it can say the same in another language (``text_in``). A catalogue maps keys to
templates as of ``str.format``; a template of several forms is ``{"one": ..., "other": ...}``, of which the parameter
``n`` chooses. Parameters are numbers, names, lists and other messages. Those with a fixed set of values, such as a
format's description or a reason for leaving something out, are translated by ``terms`` of the catalogue.
"""

from __future__ import annotations

import json
import math
import string
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from itertools import zip_longest
from pathlib import Path
from typing import Any

LANGUAGES = ("en", "de")
"""The first is what is stored, logged and said where no language is asked for."""
TERMS = "terms"
"""The key under which a catalogue has the words of other languages for fixed English ones."""
_POINTS = str.maketrans(",.", ".,")
"""Thousands and decimals."""
JOINED = "joined"
"""The key of several messages, one after the other."""

_spoken = ContextVar("language", default="en")
_folders = [Path(__file__).parent / "catalogues"]


class Message(str):
    """A sentence in English, with its ``key`` in the catalogues and the ``parameters`` of its template.

    ``key`` is empty where the words are nobody's but their own.
    """

    key: str
    parameters: Mapping[str, Any]

    def __new__(cls, text: str, key: str = "", parameters: Mapping[str, Any] | None = None) -> Message:
        """The sentence as it stands in English; ``say`` makes them from the catalogue."""
        message = super().__new__(cls, text)
        message.key, message.parameters = key, parameters or {}
        return message


def add_catalogues(folder: Path) -> None:
    """Have the catalogues in a folder, ``en.json`` and so on, beside the library's."""
    if folder not in _folders:
        _folders.append(folder)
        catalogue.cache_clear()


@cache
def catalogue(language: str) -> dict[str, Any]:
    """All templates of a language by their keys."""
    out: dict[str, Any] = {TERMS: {}}
    for folder in _folders:
        read = json.loads((folder / f"{language}.json").read_text(encoding="utf-8"))
        terms = out[TERMS] | read.get(TERMS, {})
        out = {**out, **read, TERMS: terms}
    return out


def say(key: str, /, **parameters: Any) -> Message:
    """The sentence of a key, which the English catalogue must have, with its parameters."""
    values = {name: _plain(value) for name, value in parameters.items()}
    return Message(_written("en", key, values), key, values)


def joined(parts: Iterable[str], by: str = " ") -> Message:
    """Sentences or phrases, one after the other."""
    said = [part for part in parts if part]
    return Message(by.join(said), JOINED, {"parts": said, "by": by})


def message_of(error: BaseException) -> str:
    """What an error says, with its key where it has one."""
    return error.args[0] if error.args and isinstance(error.args[0], Message) else str(error)


def said(text: str | None) -> dict[str, Any] | None:
    """Key and parameters of a sentence as JSON; None where it has none. Messages among the parameters have the same."""
    if not isinstance(text, Message) or not text.key:
        return None
    return {"key": text.key, "parameters": {name: _as_json(one) for name, one in text.parameters.items()}}


def with_key(text: str, key_and_parameters: Mapping[str, Any] | None) -> str:
    """The sentence again that was stored as its text and what ``said`` made of it."""
    if not key_and_parameters:
        return text
    return Message(text, key_and_parameters["key"], key_and_parameters["parameters"])


def remarks_of(report: Mapping[str, Any]) -> list[str]:
    """The warnings of a report, each with its key where it has one."""
    texts = report.get("warnings", ())
    return [with_key(*one) for one in zip_longest(texts, report.get("warnings_said", ())[: len(texts)])]


def with_remarks(report: Mapping[str, Any], remarks: Sequence[str]) -> dict[str, Any]:
    """The report with these warnings, as sentences and, one for one, as what ``said`` makes of them."""
    return {**report, "warnings": list(remarks), "warnings_said": [said(one) for one in remarks]}


def text_in(language: str, text: str) -> str:
    """A sentence in a language; as it stands where the language has no words for it."""
    if language == "en" or not isinstance(text, Message) or not text.key:
        return text
    try:
        return _written(language, text.key, text.parameters)
    except KeyError:
        return text


def term(language: str, text: str) -> str:
    """A fixed word or phrase of English in a language; as it stands where the language has none for it."""
    return str(catalogue(language)[TERMS].get(text, text))


@contextmanager
def speaking(language: str) -> Iterator[None]:
    """Have ``told`` say things in a language while the block runs."""
    before = _spoken.set(language)
    try:
        yield
    finally:
        _spoken.reset(before)


def told(text: str) -> str:
    """A sentence, or a fixed word or phrase, in the language that is spoken here (``speaking``); else English."""
    language = _spoken.get()
    if language == "en":
        return text
    return text_in(language, text) if isinstance(text, Message) and text.key else term(language, text)


class _Writer(string.Formatter):
    """Writes values into templates as a language does."""

    def __init__(self, language: str) -> None:
        self._language = language

    def convert_field(self, value: Any, conversion: Any) -> Any:
        if not conversion:
            return value
        if isinstance(value, str) and not isinstance(value, Message):  # somebody's own name, no word of ours
            return Message(super().convert_field(value, conversion))
        return super().convert_field(self._value(value), conversion)

    def format_field(self, value: Any, format_spec: str) -> str:
        text = format(
            self._value(value), "" if isinstance(value, str) else format_spec
        )  # a figure may be blanked
        is_figure = isinstance(value, int | float) and self._language != "en"
        return text.translate(_POINTS) if is_figure else text

    def _value(self, value: Any) -> Any:
        if isinstance(value, list | tuple):
            return ", ".join(str(self._value(one)) for one in value)
        if isinstance(value, Mapping):
            return _written(self._language, value["key"], value["parameters"])
        if isinstance(value, Message):
            return text_in(self._language, value)
        return term(self._language, value) if isinstance(value, str) else value


def _written(language: str, key: str, parameters: Mapping[str, Any]) -> str:
    """The words of a key in a language; ``KeyError`` where it has none."""
    writer = _Writer(language)
    if key == JOINED:
        return term(language, str(parameters["by"])).join(
            writer.format("{0}", one) for one in parameters["parts"]
        )
    template = catalogue(language)[key]
    if isinstance(template, dict):
        template = template["one" if parameters.get("n") == 1 else "other"]
    return writer.vformat(template, (), parameters)


def _plain(value: Any) -> Any:
    """A parameter as JSON has it, but for messages, which stay."""
    if isinstance(value, BaseException):
        value = message_of(value)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    item = getattr(value, "item", None)  # NumPy's numbers
    return item() if item is not None else str(value)


def _as_json(value: Any) -> Any:
    if isinstance(value, Message):
        return said(value) or str(value)
    if isinstance(value, list | tuple):
        return [_as_json(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
