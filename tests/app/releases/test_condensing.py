"""What is told is condensed part by part, every other one beside: the sums are those of all at once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from sqlalchemy import text
from sqlalchemy.orm import Session

from app.core.beside import Beside
from app.core.caller import TOLD
from app.core.db import make_engine, session_factory
from app.releases import condensing
from app.releases.condensed_drives import CondensedDrives, ToldDrives, condense
from fusion.network.condensed import CondensedPasses
from fusion.network.drive_constants import ConstantsInformation
from fusion.types import no_progress
from release_support import LONG, Public, public

__all__ = ["public"]

OWNERS = 5

Said = tuple[dict[int, CondensedPasses], dict[str, ConstantsInformation]]


@pytest.fixture
def told(public: Public) -> Iterator[Session]:
    """A transaction over what an edition tells, taken back at the end."""
    for owner in range(OWNERS):
        public.drive(owner, range(LONG), 3.0 + 0.1 * owner)
    public.release()
    engine = make_engine(str(public.settings.database_url), schema=TOLD)
    with session_factory(engine)() as session:
        yield session
    engine.dispose()


def said(session: Session) -> Said:
    """What is condensed of segments and of drives."""
    sums = session.execute(text("SELECT segment_id, evidence FROM condensed_passes")).all()
    drives = session.execute(text("SELECT drive_id, evidence FROM drive_constants")).all()
    return (
        {segment: CondensedPasses.decode(data) for segment, data in sums},
        {str(drive): ConstantsInformation.decode(data) for drive, data in drives},
    )


def anew(session: Session) -> Said:
    """The same, condensed anew."""
    drives = list(session.execute(text("SELECT id FROM drives")).scalars())
    segments = list(session.execute(text("SELECT DISTINCT segment_id FROM drive_passes")).scalars())
    condensing.condense_told(session, drives, segments, no_progress)
    return said(session)


def assert_same(one: Said, other: Said) -> None:
    """To rounding: parts are added up."""
    (sums, drives), (other_sums, other_drives) = one, other
    assert sums.keys() == other_sums.keys() and drives.keys() == other_drives.keys()
    for segment, value in sums.items():
        assert value.drives == other_sums[segment].drives
        scale = np.abs(value.information).max()
        assert np.allclose(value.information, other_sums[segment].information, rtol=0, atol=1e-9 * scale)
    for name, constants in drives.items():
        assert np.array_equal(constants.information, other_drives[name].information)


def test_parts_are_condensed_here_and_beside(told: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = said(told)
    assert len(whole[1]) == OWNERS
    asked = []

    def here(drives: ToldDrives) -> CondensedDrives:
        asked.append(drives)
        return condense(drives)

    monkeypatch.setattr(condensing, "condense", here)
    monkeypatch.setattr(condensing, "DRIVES_AT_ONCE", 1)
    assert_same(anew(told), whole)
    assert len(asked) == 3, "the second and the fourth drive were condensed beside"


def test_what_a_process_that_ended_was_to_condense_is_condensed_here(
    told: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Ended(Beside):
        def __init__(self, module: object) -> None:
            super().__init__(condensing.condensing_process)
            self.process.kill()
            self.process.wait()

    whole = said(told)
    monkeypatch.setattr(condensing, "Beside", Ended)
    monkeypatch.setattr(condensing, "DRIVES_AT_ONCE", 2)
    assert_same(anew(told), whole)
