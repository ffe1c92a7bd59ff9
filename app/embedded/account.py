"""The user account that PostgreSQL runs under. It refuses to run as root, so root drops to another user."""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.core.messages import say
from app.embedded.errors import EmbeddedPostgresError

UNPRIVILEGED_USERS = ("postgres", "nobody")
TRAVERSING_CAPABILITIES = ("dac_read_search", "dac_override")
"""Either lets a process pass through folders that its user may not enter, the weaker one first."""


@dataclass(frozen=True)
class Account:
    """Whom to run as: ``uid`` is None where we are unprivileged already; ``prefix`` wraps each command."""

    uid: int | None
    gid: int | None
    prefix: tuple[str, ...] = ()

    def run(
        self, command: Sequence[str], *, cwd: Path = Path("/"), **environ: str
    ) -> subprocess.CompletedProcess[str]:
        """Run to the end; return the status with the output (standard error included), whatever the status.

        The child has its own session, so that a Ctrl-C meant for the application does not reach it, and an
        environment without PostgreSQL's variables but for the given ones.
        """
        dropping = self.uid is not None and not self.prefix
        return subprocess.run(  # noqa: S603 - programs of PostgreSQL with our own arguments
            [*self.prefix, *command],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            cwd=cwd,
            env=_environment(os.environ) | environ,
            umask=0o077,
            start_new_session=True,
            user=self.uid if dropping else None,
            group=self.gid if dropping else None,
            extra_groups=() if dropping else None,
        )

    def own(self, path: Path | int) -> None:
        """Give a folder or file, or one that is open, to this account."""
        if self.uid is not None and self.gid is not None:
            os.chown(path, self.uid, self.gid)

    def can_enter(self, folders: Sequence[Path]) -> bool:
        """Whether programs run by this account reach every one of the folders."""
        try:
            return all(
                self.run(["/bin/sh", "-c", 'cd -- "$0"', str(folder)]).returncode == 0 for folder in folders
            )
        except OSError:
            return False


def account_for(folder: Path) -> Account:
    """Who owns the cluster in ``folder`` (which exists): ourselves, or for root an unprivileged user.

    A cluster that a user made earlier stays that user's when root starts it.
    """
    if os.geteuid() != 0:
        return Account(None, None)
    owner = folder.stat()
    if owner.st_uid != 0:
        return Account(owner.st_uid, owner.st_gid)
    for name in UNPRIVILEGED_USERS:
        try:
            user = pwd.getpwnam(name)
        except KeyError:
            continue
        return Account(user.pw_uid, user.pw_gid)
    return Account(65534, 65534)


def with_access(account: Account, folders: Sequence[Path]) -> Account:
    """The account, with as little extra power as it takes to reach ``folders``.

    A folder below /root, or made by ``mktemp -d``, is closed to the unprivileged user. Root then hands on the
    one capability to pass through; PostgreSQL has no objection to it, only to being root.
    """
    for candidate in (account, *_empowered(account)):
        if candidate.can_enter(folders):
            return candidate
    where = ", ".join(str(folder) for folder in folders)
    raise EmbeddedPostgresError(say("embedded.root", uid=account.uid, place=where))


def _empowered(account: Account) -> list[Account]:
    setpriv = shutil.which("setpriv")
    if account.uid is None or setpriv is None:
        return []
    identity = (f"--reuid={account.uid}", f"--regid={account.gid}", "--clear-groups")
    return [
        Account(
            account.uid,
            account.gid,
            (setpriv, *identity, f"--inh-caps=+{cap}", f"--ambient-caps=+{cap}", "--"),
        )
        for cap in TRAVERSING_CAPABILITIES
    ]


def _environment(environ: Mapping[str, str]) -> dict[str, str]:
    # PGPORT, PGDATA, PGOPTIONS ... of the caller mean another server; messages are wanted in one language.
    clean = {name: value for name, value in environ.items() if not name.startswith(("PG", "LC_", "LANG"))}
    return clean | {"LC_ALL": "C"}
