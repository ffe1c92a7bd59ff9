"""The table from errors to kinds of problems is complete."""

from __future__ import annotations

from sqlalchemy.exc import OperationalError

from app.core.errors import KINDS, STATUS_KINDS, kind_of
from fusion import errors as fusion_errors
from fusion.errors import FusionError


def test_every_error_of_the_library_has_a_row() -> None:
    found = [
        cls for cls in vars(fusion_errors).values() if isinstance(cls, type) and issubclass(cls, FusionError)
    ]
    assert len(found) > 10
    for cls in found:
        assert cls in KINDS, cls
        assert KINDS[cls].slug == cls.kind
        assert 400 <= KINDS[cls].status < 500


def test_kinds_are_told_apart_by_their_type() -> None:
    rows = {kind.slug: kind for kind in KINDS.values()}
    assert len(rows) == len(set(KINDS.values()))
    assert kind_of(OperationalError("x", {}, Exception())).status == 503
    assert kind_of(ZeroDivisionError()).status == 500
    assert all(STATUS_KINDS[status].status == status for status in STATUS_KINDS)
