"""The embedded server's configuration."""

from __future__ import annotations

from pathlib import Path

from app.embedded.sockets import PORT

INCLUDE = "versant.conf"
"""Written anew at each start, included by postgresql.conf."""

HBA = """\
# Only the Unix socket exists, in a folder that nobody else can enter.
local all all trust
"""

_ALWAYS = """\
# Written by Versant at each start. Your own settings go into postgresql.conf, below the include.
listen_addresses = ''
port = {port}
unix_socket_directories = '{socket_dir}'
unix_socket_permissions = 0700
max_connections = 100
shared_buffers = 128MB
maintenance_work_mem = 128MB
# One server without replicas: bulk loads into new tables need no log.
wal_level = minimal
max_wal_senders = 0
# Tile queries are short; compiling them takes longer than running them.
jit = off
log_checkpoints = off
log_timezone = 'UTC'
timezone = 'UTC'
"""

_FORGETFUL = """\
# For tests: a power cut may destroy the cluster.
fsync = off
synchronous_commit = off
full_page_writes = off
"""


def server_settings(socket_dir: Path, *, durable: bool) -> str:
    """The text of ``versant.conf``. ``socket_dir`` holds no character that would need quoting."""
    text = _ALWAYS.format(port=PORT, socket_dir=socket_dir)
    return text if durable else text + _FORGETFUL
