"""The process beside that condenses what is told of some drives."""

from __future__ import annotations

from multiprocessing.connection import Connection

from app.core.beside import Beside
from app.releases.condensed_drives import condense


def serve(pipe: Connection) -> None:
    """Condense what comes until the other end closes, as it does however that process ends."""
    while True:
        try:
            told = pipe.recv()
        except EOFError:
            return
        pipe.send(condense(told))


if __name__ == "__main__":
    serve(Beside.end_of_pipe())
