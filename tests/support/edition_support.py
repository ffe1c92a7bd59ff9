"""An edition as a release leaves it, of a live map that is told as it is."""

from __future__ import annotations

from datetime import date

from sqlalchemy import text

from app.core.caller import EDITION
from app.core.db import Sessions, make_engine, session_factory
from app.core.settings import Settings
from app.releases.store import Edition, get_edition

DAY = date(2026, 11, 20)
_TABLES = ("segment_slopes", "cells", "ways", "drawn_pieces")
_DATED = ("segment_slopes", "ways")
_ADD = text("""
    INSERT INTO editions (number, day, owners, owners_needed, segments, length_m, withheld_share, withheld_length_share)
    SELECT :number, :day, 3, 5, count(*), coalesce(sum(s.length_m), 0), 0.31, 0.27
    FROM edition.segment_slopes AS a JOIN segments AS s ON s.id = a.segment_id WHERE a.drives > 0
""")


def add_edition(sessions: Sessions, number: int, day: date = DAY) -> Edition:
    """The live map as the edition of this number, without files."""
    with sessions.begin() as session:
        for table in _TABLES:
            session.execute(text(f"DELETE FROM edition.{table}"))
            session.execute(text(f"INSERT INTO edition.{table} SELECT * FROM public.{table}"))
        for table in _DATED:
            session.execute(text(f"UPDATE edition.{table} SET updated_at = :day"), {"day": day})
        session.execute(_ADD, {"number": number, "day": day})
        edition = get_edition(session, number)
    assert edition is not None
    return edition


def edition_sessions(settings: Settings) -> Sessions:
    """Sessions that read the edition."""
    return session_factory(make_engine(str(settings.database_url), schema=EDITION))
