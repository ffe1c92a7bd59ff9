"""Compiling ahead: whatever can be chosen is run, and runs to its end, so that no lane finds a loop uncompiled."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import pytest

from app.cli import compiling
from fusion.catalogue import METHODS, POSITIONINGS
from fusion.errors import FusionError
from fusion.pipeline import run_drive
from fusion.registry import DEFAULT_METHOD


@pytest.mark.slow
def test_each_choice_of_each_option_runs_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: dict[str, set[tuple[str, Any]]] = defaultdict(set)
    ended_early = []

    def run(*inputs: Any, method: str = DEFAULT_METHOD, options: Any) -> object:
        name = options.get("gnss", method)
        chosen[name] |= set(options.get("gnss_options", options).items())
        try:
            return run_drive(*inputs, method=method, options=options)
        except FusionError as error:
            ended_early.append((name, error.kind))
            raise

    monkeypatch.setattr(compiling, "run_drive", run)
    with compiling._scene() as scene:
        for _, step in compiling._other_steps(scene):
            step()
    # Of the two formats with raw signals one has no positions of the receiver's own.
    assert ended_early == [("receiver", "empty-log")]
    for name, thing in (*METHODS.items(), *POSITIONINGS.items()):
        for option, schema in thing.options_model.model_json_schema().get("properties", {}).items():
            values = {True, False} if schema.get("type") == "boolean" else set(schema.get("enum", ()))
            if option not in {"gnss", "gnss_options", "columns"}:
                untried = values - {schema.get("default")}
                assert {(option, value) for value in untried} <= chosen[name], (name, option)
