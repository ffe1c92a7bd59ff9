"""The process that draws (``drawing``). It loads no more than that takes: neither web nor database."""

from __future__ import annotations

import gc
import sys
import traceback
from multiprocessing.connection import Connection

import app.core.messages  # noqa: F401 - adds its catalogues
from fusion.messages import speaking


def draw(pipe: Connection) -> None:
    """Draw what comes until the other end closes, as it does however that process ends."""
    from app.drives.outputs.profile_picture import profile_png  # noqa: PLC0415 - here alone matplotlib is loaded

    while True:
        try:
            profile, title, measurements, datum, language = pipe.recv()
        except EOFError:
            return
        try:
            with speaking(language):
                answer = (profile_png(profile, title, measurements, datum=datum), "")
        except Exception:  # whatever it is: the next picture may be drawn
            answer = (b"", traceback.format_exc())
        pipe.send(answer)
        del profile, measurements, answer
        gc.collect()  # a figure is one large cycle, and several would wait to be found


if __name__ == "__main__":
    draw(Connection(int(sys.argv[1])))
