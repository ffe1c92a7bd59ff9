"""Compiling ahead: whatever can be chosen is run, and runs to its end, so that no lane finds a loop uncompiled."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable
from typing import Any

import pytest

from app.cli import compiling
from fusion.catalogue import METHODS, POSITIONINGS
from fusion.errors import FusionError
from fusion.pipeline import positions_of, run_drive
from fusion.registry import DEFAULT_METHOD
from fusion.types import DriveLog


@pytest.mark.long("half a minute of computing: every choice of every method and positioning")
def test_each_choice_of_each_option_runs_to_its_end(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: dict[str, set[tuple[str, Any]]] = defaultdict(set)
    ended_early = []

    def noted(name: str, options: Any, run: Callable[[], object]) -> object:
        chosen[name] |= {(option, value) for option, value in options.items() if isinstance(value, Hashable)}
        try:
            return run()
        except FusionError as error:
            ended_early.append((name, error.kind))
            raise

    def run(*inputs: Any, method: str, options: Any) -> object:
        return noted(method, options, lambda: run_drive(*inputs, method=method, options=options))

    def positions(log: DriveLog, options: Any) -> object:
        return noted(options.gnss, options.gnss_options, lambda: positions_of(log, options))

    monkeypatch.setattr(compiling, "run_drive", run)
    monkeypatch.setattr(compiling, "positions_of", positions)
    monkeypatch.setattr(compiling, "_first_steps", lambda _: [])
    with compiling._scene() as scene:
        for _, step in compiling._steps(scene):
            step()
    # Of the two formats with raw signals one has no positions of the receiver's own.
    assert ended_early == [(DEFAULT_METHOD, "empty-log")]
    for name, thing in (*METHODS.items(), *POSITIONINGS.items()):
        for option, schema in thing.options_model.model_json_schema().get("properties", {}).items():
            values = {True, False} if schema.get("type") == "boolean" else set(schema.get("enum", ()))
            if option not in {"gnss", "gnss_options", "columns"}:
                untried = values - {schema.get("default")}
                assert {(option, value) for value in untried} <= chosen[name], (name, option)
