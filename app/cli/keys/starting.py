"""What the first start of a service does about keys, and what later ones say of them."""

from __future__ import annotations

from app.access.folder import operator_key
from app.access.store import create_link
from app.cli.database import sessions_of
from app.cli.keys.finding import key_of_folder
from app.core.settings import Settings


def see_to_key(settings: Settings) -> None:
    """Have ``operator.key`` in the data folder, unless no keys are asked for."""
    if settings.access == "keys":
        with sessions_of(settings) as factory:
            operator_key(settings.data_dir, factory)


def first_link(settings: Settings) -> str | None:
    """The same, and the token of a login link of that key; None where no keys are asked for."""
    if settings.access == "open":
        return None
    with sessions_of(settings) as factory:
        operator_key(settings.data_dir, factory)
        with factory.begin() as session:
            key_id = key_of_folder(session, settings.data_dir)
            assert key_id is not None  # noqa: S101 - it was just seen to
            return create_link(session, key_id)
