"""The picture of a drive's profile: drawn when it is first asked for, and kept. Knows no route."""

from __future__ import annotations

import logging
import uuid

from sqlalchemy.exc import SQLAlchemyError

from app.core.http import Service, existing
from app.drives import store as drives
from app.drives import tracks
from app.drives.documents import Drive
from app.drives.outputs.drawing import Drawing
from app.drives.outputs.profile_marks import datum_words
from app.drives.parts.reading import drive_and_track, drive_profile
from app.drives.parts.without_ends import Ends, shown_measurements

log = logging.getLogger(__name__)


def kept_picture(service: Service, drive_id: uuid.UUID) -> bytes | None:
    """The picture of the whole drive as it is now, where it was drawn already."""
    with service.reading() as session:
        drive = existing(drives.get_drive(session, drive_id), "drive", drive_id)
        return tracks.read_picture(session, drive)


def picture_to_keep(service: Service, drawing: Drawing, drive_id: uuid.UUID) -> bytes:
    """The picture of the whole drive, which is kept."""
    # Another request may have drawn it while this one waited.
    if drawn := kept_picture(service, drive_id):
        return drawn
    drive, picture = _draw(service, drawing, drive_id, None)
    try:
        with service.sessions.begin() as session:
            tracks.keep_picture(session, drive, picture, service.settings.pictures_kept)
    except SQLAlchemyError as error:  # it is a picture nevertheless
        log.warning("the picture of drive %s is not kept: %s", drive_id, error)
    return picture


def picture_of_its_own(
    service: Service, drawing: Drawing, drive_id: uuid.UUID, ends: Ends, language: str
) -> bytes:
    """A picture that is not kept: without the ends of the trip, as places and zones may change, or not in English."""
    return _draw(service, drawing, drive_id, ends, language)[1]


def _draw(
    service: Service, drawing: Drawing, drive_id: uuid.UUID, ends: Ends, language: str = "en"
) -> tuple[Drive, bytes]:
    with service.reading() as session:
        drive, track = drive_and_track(session, drive_id, ends)
        profile = drive_profile(session, drive_id, track)
        measurements = shown_measurements(tracks.read_measurements(session, drive_id), track, ends)
    datum = datum_words(drive.report or {})
    return drive, drawing.profile(profile, drive.filename, measurements, datum, language)
