"""Background priority: processes that compute leave the processor to processes that answer requests.

On a small machine the API, the workers, an import and PostgreSQL share two cores. With equal priorities a request waits
behind all that is computed. A process with background priority has a tenth of the weight of an ordinary one, and so
have its connections' processes on a database server of this machine. Alone on the machine it is as fast as ever.
"""

from __future__ import annotations

import os
import socket
import struct
from contextlib import suppress
from pathlib import Path
from typing import Any

NICENESS = 10
"""Each step is a fifth less: ten are a tenth of the weight."""

_PEER_CREDENTIALS = "3i"  # process, user, group


def lower_priority() -> None:
    """Give background priority to this process and to those that it starts from here on."""
    os.nice(max(0, NICENESS - os.nice(0)))
    # Linux may weigh sessions first, then the processes in each. Only our own session is ours to weigh.
    if os.getsid(0) == os.getpid():
        with suppress(OSError):  # another system, or one that does not weigh them
            Path("/proc/self/autogroup").write_text(str(NICENESS))


def lower_server_priority(connection: Any) -> None:
    """Give background priority to the server's process of a psycopg connection, if it runs here and we may."""
    pid = connection.info.backend_pid
    with suppress(OSError, ValueError, IndexError, AttributeError):
        if _parent_of(pid) == _server_of(connection.fileno()):
            os.setpriority(os.PRIO_PROCESS, pid, NICENESS)


def _server_of(descriptor: int) -> int:
    """The process that listens at the other end of a Unix socket, as this machine numbers it; none: OSError."""
    with socket.socket(fileno=os.dup(descriptor)) as end:
        if end.family != socket.AF_UNIX:
            raise OSError("the server may be on another machine")
        size = struct.calcsize(_PEER_CREDENTIALS)
        return int(
            struct.unpack(_PEER_CREDENTIALS, end.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))[0]
        )


def _parent_of(pid: int) -> int:
    """By the number that the server knows itself by: in another container it means another process, or none."""
    stat = Path(f"/proc/{pid}/stat").read_text()
    return int(stat.rpartition(")")[2].split()[1])
