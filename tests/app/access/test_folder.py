"""``operator.key`` of a data folder: made once, readable by its user alone, made anew where it does not count."""

from __future__ import annotations

import errno
import uuid
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from app.access import folder as of_folder
from app.access import store
from app.access.folder import FILE, KEY_FORM, LABEL, operator_key, read_key
from app.core.caller import OPERATOR_OWNER
from app.core.db import Sessions


def keys(sessions: Sessions) -> list[tuple[uuid.UUID, bool]]:
    """The keys that folders have had, and whether each counts, the first one first."""
    with sessions() as session:
        found = store.list_keys(session, OPERATOR_OWNER)
    return [(key.id, key.revoked_at is None) for key in found if key.label == LABEL]


def operates(sessions: Sessions, secret: str) -> bool:
    with sessions.begin() as session:
        known = store.by_key(session, secret)
    return known is not None and (known.caller.scope, known.caller.owner_id) == ("operate", OPERATOR_OWNER)


def test_the_first_start_makes_a_key_that_its_user_alone_reads(tmp_path: Path, sessions: Sessions) -> None:
    secret = operator_key(tmp_path, sessions)
    assert KEY_FORM.fullmatch(secret)
    assert (tmp_path / FILE).read_text() == secret + "\n"
    assert (tmp_path / FILE).stat().st_mode & 0o777 == 0o600
    assert [path.name for path in tmp_path.iterdir()] == [FILE]
    assert operates(sessions, secret)


def test_later_starts_leave_it_as_it_is(tmp_path: Path, sessions: Sessions) -> None:
    secret = operator_key(tmp_path, sessions)
    before = (tmp_path / FILE).stat()
    assert operator_key(tmp_path, sessions) == secret == read_key(tmp_path)
    assert (tmp_path / FILE).stat().st_mtime_ns == before.st_mtime_ns
    assert len(keys(sessions)) == 1


def test_a_file_that_others_may_read_is_closed(tmp_path: Path, sessions: Sessions) -> None:
    operator_key(tmp_path, sessions)
    (tmp_path / FILE).chmod(0o644)
    operator_key(tmp_path, sessions)
    assert (tmp_path / FILE).stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("content", [None, "", "not a key\n", "vsk_" + "A" * 43])
def test_a_lost_or_damaged_file_is_made_anew_and_its_key_revoked(
    tmp_path: Path, sessions: Sessions, content: str | None
) -> None:
    lost = operator_key(tmp_path, sessions)
    if content is None:
        (tmp_path / FILE).unlink()
    else:
        (tmp_path / FILE).write_text(content)
    secret = operator_key(tmp_path, sessions)
    assert secret != lost
    assert not operates(sessions, lost)
    assert operates(sessions, secret)
    assert [counts for _, counts in keys(sessions)] == [False, True]


def test_a_revoked_key_is_made_anew(tmp_path: Path, sessions: Sessions) -> None:
    former = operator_key(tmp_path, sessions)
    with sessions.begin() as session:
        store.revoke_key(session, keys(sessions)[0][0])
    secret = operator_key(tmp_path, sessions)
    assert secret != former
    assert operates(sessions, secret)


def test_a_key_that_does_not_operate_will_not_do(tmp_path: Path, sessions: Sessions) -> None:
    with sessions.begin() as session:
        _, small = store.create_key(session, OPERATOR_OWNER, "a phone", "own")
    (tmp_path / FILE).write_text(small)
    secret = operator_key(tmp_path, sessions)
    assert secret != small
    assert operates(sessions, secret)
    with sessions.begin() as session:
        assert store.by_key(session, small) is not None, "keys of other labels are left alone"


def test_two_that_start_at_once_have_one_key(tmp_path: Path, sessions: Sessions) -> None:
    with ThreadPoolExecutor(8) as pool:
        secrets = set(pool.map(lambda _: operator_key(tmp_path, sessions), range(8)))
    assert secrets == {read_key(tmp_path)}
    assert [counts for _, counts in keys(sessions)] == [True]


def test_where_the_file_cannot_be_written_nothing_changes(
    tmp_path: Path, sessions: Sessions, monkeypatch: pytest.MonkeyPatch
) -> None:
    secret = operator_key(tmp_path, sessions)
    (tmp_path / FILE).rename(tmp_path / "kept")

    def full(part: Path, target: Path) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(target))

    with monkeypatch.context() as broken, pytest.raises(OSError, match="No space"):
        broken.setattr(of_folder, "rename_durably", full)
        operator_key(tmp_path, sessions)
    assert [path.name for path in tmp_path.iterdir()] == ["kept"]
    assert operates(sessions, secret)
    (tmp_path / "kept").rename(tmp_path / FILE)
    assert operator_key(tmp_path, sessions) == secret


def test_nothing_to_read_is_no_key(tmp_path: Path) -> None:
    assert read_key(tmp_path) is None
    assert read_key(tmp_path / "none") is None
