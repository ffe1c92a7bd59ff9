"""What runs in the process that draws (``drawing``). It loads no more than that takes: neither web nor database."""

from __future__ import annotations

import signal
import traceback
from multiprocessing.connection import Connection

from app.core.standing_back import stand_back


def draw(pipe: Connection) -> None:
    """Draw what comes until the other end closes, as it does however that process ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C in the terminal is for the parent
    stand_back()
    from app.drives.outputs.profile_picture import profile_png  # noqa: PLC0415 - here alone matplotlib is loaded

    while True:
        try:
            profile, title, measurements = pipe.recv()
        except EOFError:
            return
        try:
            answer = (profile_png(profile, title, measurements), "")
        except Exception:  # whatever it is: the next picture may be drawn
            answer = (b"", traceback.format_exc())
        pipe.send(answer)
