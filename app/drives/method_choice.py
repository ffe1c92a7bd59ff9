"""The estimator, its options and how positions are computed, as requests choose them: parameters, defaults, checks."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from fastapi import Query
from pydantic import BaseModel, Field

from app.core.errors import BadRequestError
from app.core.messages import say
from app.core.settings import Settings
from fusion.errors import BadOptionsError
from fusion.registry import DEFAULT_METHOD, METHOD_NAMES, RequestMost, check_columns, unknown_name


class MethodRequest(BaseModel):
    """The estimator, its options and how positions are computed, as query parameters."""

    method: str | None = Field(
        None,
        description="The estimator (`versant methods` lists them); unset: the service's default.",
        examples=[DEFAULT_METHOD],
    )
    options: str | None = Field(
        None, description="Options of the method, a JSON object.", examples=['{"particles": 10000}']
    )
    option: list[str] = Field(
        [], description="One option as `name:value`; may be repeated.", examples=[["particles:10000"]]
    )
    gnss: str | None = Field(
        None,
        description="How positions are computed (`versant methods` lists the ways), short for the option `gnss` of "
        "every method.",
        examples=["receiver"],
    )
    gnss_option: list[str] = Field(
        [],
        description="One option of that as `name:value`, short for one in `gnss_options`; may be repeated.",
        examples=[[]],
    )

    def asked_options(self) -> dict[str, Any] | None:
        """The options of the query parameters together; None where there are none.

        A value after the colon is JSON where it can be, else text. Raises ``BadRequestError``.
        """
        if self.options is None and not self.option:
            return None
        from_json = _json_object(self.options) if self.options is not None else {}
        return from_json | _pairs(self.option, "option")


MethodQuery = Annotated[MethodRequest, Query()]


def default_method(settings: Settings) -> str:
    """The default estimator: that of the settings, else the library's."""
    return settings.default_method or DEFAULT_METHOD


def asked_positioning(gnss: str | None, gnss_option: Sequence[str]) -> dict[str, Any]:
    """The shorthands for how positions are computed, as options of a method; ``UnknownNameError`` lists the names."""
    options: dict[str, Any] = {}
    if gnss is not None:
        from fusion.catalogue import POSITIONINGS  # noqa: PLC0415 - see check_options

        options["gnss"] = POSITIONINGS[gnss].name
    if gnss_option:
        options["gnss_options"] = _pairs(gnss_option, "gnss_option")
    return options


def asked_columns(columns: Sequence[str]) -> dict[str, Any]:
    """The columns of the query as an option of a method; ``BadOptionsError`` for one that is none of ours."""
    named: dict[str, str] = {}
    for text in columns:
        ours, equals, theirs = text.partition("=")
        if not equals:
            raise BadRequestError(
                say("columns.write_so", text=text[:80]),
                field="columns",
            )
        named[ours.strip()] = theirs.strip()
    check_columns(named)
    return {"columns": named} if named else {}


def with_columns_kept(options: Mapping[str, Any], had: Mapping[str, Any]) -> dict[str, Any]:
    """``options`` with the columns and heights of the options before: they belong to the file, not to the method."""
    return {name: had[name] for name in ("columns", "heights") if name in had} | dict(options)


def with_positioning(options: Mapping[str, Any], positioning: Mapping[str, Any]) -> dict[str, Any]:
    """``options`` with another positioning; the options that belong to the one before go with it."""
    combined = dict(options)
    if "gnss" in combined and positioning.get("gnss", combined["gnss"]) != combined["gnss"]:
        combined.pop("gnss_options", None)
    return combined | dict(positioning)


def chosen_anew(
    method: str | None,
    options: Mapping[str, Any] | None,
    positioning: Mapping[str, Any],
    had: tuple[str, Mapping[str, Any]],
) -> tuple[str, dict[str, Any]]:
    """The method and the options for another run of a drive that ``had`` these: both of them where none is named.

    With a method alone that method's defaults. Raises what ``check_options`` does.
    """
    former_method, former_options = had
    chosen = former_options if method is None and options is None else options or {}
    chosen = with_positioning(with_columns_kept(chosen, former_options), positioning)
    estimator = former_method if method is None else method
    check_options(estimator, chosen)
    return estimator, chosen


def check_options(method: str, options: Mapping[str, Any]) -> None:
    """Raise ``UnknownNameError`` or ``BadOptionsError`` for what cannot be used.

    Methods are loaded only if options are named: with their compilers they take nearly half of the memory of an API
    process.
    """
    if method not in METHOD_NAMES:
        raise unknown_name("method", method, METHOD_NAMES)
    columns = options.get("columns")
    if isinstance(columns, dict) and all(isinstance(part, str) for pair in columns.items() for part in pair):
        check_columns(columns)
        options = {name: value for name, value in options.items() if name != "columns"}
    if options:
        from fusion.catalogue import POSITIONINGS  # noqa: PLC0415
        from fusion.gnss.positioning import options_of  # noqa: PLC0415
        from fusion.pipeline import parse_options  # noqa: PLC0415

        chosen = parse_options(method, options)
        _require_modest(chosen, f"method {method!r}")
        _require_modest(
            options_of(POSITIONINGS[chosen.gnss], chosen.gnss_options), f"positioning {chosen.gnss!r}"
        )


def _require_modest(options: BaseModel, owner: str) -> None:
    """``BadOptionsError`` for a number that takes gigabytes or hours of a worker that serves others too."""
    for name, field in type(options).model_fields.items():
        for mark in field.metadata:
            if isinstance(mark, RequestMost) and getattr(options, name) > mark.most:
                raise BadOptionsError(
                    say(
                        "options.too_much",
                        name=name,
                        owner=owner,
                        value=getattr(options, name),
                        most=mark.most,
                    ),
                    where=name,
                )


def _pairs(texts: Sequence[str], field: str) -> dict[str, Any]:
    pairs = {}
    for text in texts:
        name, colon, value = text.partition(":")
        if not colon or not name:
            raise BadRequestError(say("options.write_so", text=text), field=field)
        pairs[name.strip()] = _json_or_text(value)
    return pairs


def _json_object(text: str) -> dict[str, Any]:
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        value = None
    if not isinstance(value, dict):
        raise BadRequestError(say("options.no_object"), field="options")
    return value


def _json_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text
