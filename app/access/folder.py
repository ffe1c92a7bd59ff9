"""The operator's key of a data folder: made at the first start, readable by the folder's user alone.

By it nobody types a key on the machine of the service. Loads no library of databases before a key is to be made.
"""

from __future__ import annotations

import fcntl
import os
import re
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from app.core.durable import rename_durably

if TYPE_CHECKING:
    from sqlalchemy.orm import Session

    from app.core.db import Sessions

FILE = "operator.key"
LABEL = "operator.key of the data folder"
KEY_FORM = re.compile(r"vsk_[A-Za-z0-9_-]{43}")
"""What every key looks like."""


def read_key(folder: Path) -> str | None:
    """The key in a data folder; None where there is none, or none that this user may read."""
    try:
        text = (folder / FILE).read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return None
    return text if KEY_FORM.fullmatch(text) else None


def operator_key(folder: Path, sessions: Sessions) -> str:
    """The key in a data folder, which operates the service on ``sessions``; made where there is none that does so.

    A key that this folder had before is revoked then. Raises ``OSError`` where the file cannot be written.
    """
    with _alone(folder), sessions.begin() as session:
        key = read_key(folder)
        if key is not None and _operates(session, key):
            with suppress(
                OSError
            ):  # another user's folder: whoever may read it there has been able to all along
                (folder / FILE).chmod(0o600)
            return key
        key = _renewed(session)
        renew_key(folder, key)  # before the commit: where it fails nothing has changed
        return key


def _operates(session: Session, key: str) -> bool:
    from app.access.store import by_key  # noqa: PLC0415 - see above

    known = by_key(session, key)
    return known is not None and known.caller.may("operate")


def _renewed(session: Session) -> str:
    """The secret of a new key of the operator; those that folders had before are revoked."""
    from app.access import store  # noqa: PLC0415 - see above
    from app.core.caller import OPERATOR_OWNER  # noqa: PLC0415

    for former in store.list_keys(session, OPERATOR_OWNER):
        if former.label == LABEL and former.revoked_at is None:
            store.revoke_key(session, former.id)
    return store.create_key(session, OPERATOR_OWNER, LABEL, "operate")[1]


def renew_key(folder: Path, key: str) -> None:
    """Write another key into a data folder; it is there whole or not at all. Raises ``OSError``."""
    handle, name = tempfile.mkstemp(
        dir=folder, prefix=f".{FILE}."
    )  # of this user alone from the first moment on
    part = Path(name)
    try:
        with os.fdopen(handle, "w", encoding="ascii") as file:
            file.write(key + "\n")
        rename_durably(part, folder / FILE)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Hold the folder's lock, which goes with the process: of two programs that start at once one makes the key."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
