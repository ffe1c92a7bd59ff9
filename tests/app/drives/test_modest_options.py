"""What a request may ask of a worker that serves others, and what a command line may."""

from __future__ import annotations

from typing import Any

import pytest

from app.drives.method_choice import check_options
from fusion.catalogue import METHODS, POSITIONINGS
from fusion.errors import BadOptionsError
from fusion.pipeline import parse_options
from fusion.registry import RequestMost

TOO_MUCH: list[tuple[str, dict[str, Any]]] = [
    ("particle", {"particles": 10_000_000}),
    ("profile", {"gnss": "pf", "gnss_options": {"particles": 100_000}}),
    ("profile", {"gnss": "rbpf-dpm", "gnss_options": {"memory": 10_000}}),
]


@pytest.mark.parametrize(("method", "options"), TOO_MUCH)
def test_a_request_may_not_ask_for_gigabytes(method: str, options: dict[str, Any]) -> None:
    parse_options(method, options)
    with pytest.raises(BadOptionsError, match="a request may ask for") as caught:
        check_options(method, options)
    assert caught.value.where in {"particles", "memory"}


MODELS = [METHODS[name].options_model for name in METHODS] + [
    POSITIONINGS[name].options_model for name in POSITIONINGS
]


@pytest.mark.parametrize("model", MODELS)
def test_what_multiplies_memory_has_a_bound_and_the_default_is_within(model: Any) -> None:
    for name, field in model.model_fields.items():
        marks = [mark.most for mark in field.metadata if isinstance(mark, RequestMost)]
        assert marks or name not in {"particles", "memory"}, f"{model.__name__}.{name}"
        assert all(field.default <= most for most in marks)
