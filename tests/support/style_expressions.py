"""An evaluator of the expressions that the map's style uses, by the words of MapLibre's specification."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

Feature = dict[str, Any]


def evaluate(expression: Any, feature: Feature, zoom: float = 16) -> Any:
    """What an expression yields for a feature's properties; an operator that it does not know is a KeyError."""
    if isinstance(expression, dict):
        return {name: evaluate(value, feature, zoom) for name, value in expression.items()}
    if not isinstance(expression, list):
        return expression
    head, *arguments = expression
    if head in SPECIAL:
        return SPECIAL[head](arguments, feature, zoom)
    return SIMPLE[head](*(evaluate(one, feature, zoom) for one in arguments))


def _interpolated(arguments: list[Any], feature: Feature, zoom: float) -> Any:
    kind, at, *stops = arguments
    value = evaluate(at, feature, zoom)
    inputs, outputs = stops[::2], [evaluate(one, feature, zoom) for one in stops[1::2]]
    k = int(np.clip(np.searchsorted(inputs, value, side="right") - 1, 0, len(inputs) - 2))
    span = inputs[k + 1] - inputs[k]
    share = np.clip((value - inputs[k]) / span, 0, 1)
    if kind[0] == "exponential":
        share = (kind[1] ** (share * span) - 1) / (kind[1] ** span - 1)
    return (1 - share) * np.asarray(outputs[k]) + share * np.asarray(outputs[k + 1])


def _stepped(arguments: list[Any], feature: Feature, zoom: float) -> Any:
    at, out, *stops = arguments
    value = evaluate(at, feature, zoom)
    for lower, later in zip(stops[::2], stops[1::2], strict=True):
        out = later if value >= lower else out
    return evaluate(out, feature, zoom)


def _matched(arguments: list[Any], feature: Feature, zoom: float) -> Any:
    value, *pairs, otherwise = arguments
    found = evaluate(value, feature, zoom)
    for labels, out in zip(pairs[::2], pairs[1::2], strict=True):
        if found in labels:
            return evaluate(out, feature, zoom)
    return evaluate(otherwise, feature, zoom)


def _coalesced(arguments: list[Any], feature: Feature, zoom: float) -> Any:
    return next((value for one in arguments if (value := evaluate(one, feature, zoom)) is not None), None)


def _figure(value: float, options: dict[str, Any]) -> str:
    assert options["min-fraction-digits"] == options["max-fraction-digits"]
    return f"{value:.{int(options['max-fraction-digits'])}f}"


SPECIAL: dict[str, Callable[[list[Any], Feature, float], Any]] = {
    "get": lambda arguments, feature, _: feature.get(arguments[0]),
    "has": lambda arguments, feature, _: arguments[0] in feature,
    "zoom": lambda _, __, zoom: zoom,
    "literal": lambda arguments, _, __: arguments[0],
    "all": lambda arguments, feature, zoom: all(evaluate(one, feature, zoom) for one in arguments),
    "case": lambda arguments, feature, zoom: evaluate(
        arguments[1 if evaluate(arguments[0], feature, zoom) else 2], feature, zoom
    ),
    "coalesce": _coalesced,
    "match": _matched,
    "step": _stepped,
    "interpolate": _interpolated,
}
SIMPLE: dict[str, Callable[..., Any]] = {
    "abs": abs,
    "ln": math.log,
    "max": max,
    "-": lambda a, b: a - b,
    "+": lambda a, b: a + b,
    "*": lambda a, b: a * b,
    "<": lambda a, b: a < b,
    ">": lambda a, b: a > b,
    ">=": lambda a, b: a >= b,
    "!": lambda a: not a,
    "concat": lambda *parts: "".join(parts),
    "number-format": _figure,
}
