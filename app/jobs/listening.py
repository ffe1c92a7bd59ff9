"""One process of a machine listens for jobs and wakes its lanes, each through a pipe.

A connection that listens cannot be shared, and a pooler in transaction mode has none: one for each machine is enough.
What is lost costs a second, after which every lane asks by itself.
"""

from __future__ import annotations

import asyncio
import json
import logging
import os
import select
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import suppress
from typing import Any

import psycopg
from procrastinate.manager import get_channel_for_queues

from app.core.settings.places import libpq_url
from app.jobs.task import QUEUE

logger = logging.getLogger(__name__)

CONNECT_TIMEOUT_S = 10
AGAIN_S = 1.0
LOOK_EVERY_S = 30.0
"""So often a connection is asked whether it is still there."""
_SOMETHING = json.dumps({"type": "job_inserted", "job_id": 0})
"""What is said where announcements may have been lost."""


def listen(url: str, ends: Sequence[int], parent: int) -> None:
    """Hand on each announcement to all ``ends`` (of pipes, to be written), until ``parent`` is closed.

    Without a thread. Whoever does not read loses what does not fit.
    """
    for end in ends:
        os.set_blocking(end, False)
    lost = False
    while True:
        try:
            with psycopg.connect(
                libpq_url(url),
                autocommit=True,
                connect_timeout=CONNECT_TIMEOUT_S,
                application_name="versant listener",
            ) as connection:
                for channel in get_channel_for_queues([QUEUE]):
                    connection.execute(psycopg.sql.SQL("LISTEN {}").format(psycopg.sql.Identifier(channel)))
                lost = False
                _tell(ends, QUEUE, _SOMETHING)
                if not _hand_on(connection, ends, parent):
                    return
        except psycopg.Error as error:
            if not lost:  # once, however long it lasts
                logger.warning("the connection that listens for jobs is lost for now: %s", error)
            lost = True
            if _is_closed(parent, AGAIN_S):
                return


def _hand_on(connection: psycopg.Connection[Any], ends: Sequence[int], parent: int) -> bool:
    """Until the connection is lost, which raises, or ``parent`` is closed: False."""
    while True:
        readable, _, _ = select.select([connection.fileno(), parent], [], [], LOOK_EVERY_S)
        if parent in readable and not os.read(parent, 4096):
            return False
        if not readable:
            connection.execute("")
        for note in connection.notifies(timeout=0):
            _tell(ends, note.channel, note.payload)


def _is_closed(parent: int, within_s: float) -> bool:
    until_s = time.monotonic() + within_s
    while (left_s := until_s - time.monotonic()) > 0:
        if select.select([parent], [], [], left_s)[0] and not os.read(parent, 4096):
            return True
    return False


def _tell(ends: Sequence[int], channel: str, payload: str) -> None:
    for end in ends:
        with suppress(BlockingIOError, BrokenPipeError):
            os.write(end, f"{channel} {payload}\n".encode())


async def announcements(end: int) -> AsyncIterator[tuple[str, str]]:
    """Channel and payload of what is said into a pipe, whose other ``end`` this is; it is left open."""
    reader = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    transport, _ = await loop.connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(os.dup(end), "rb", buffering=0)
    )
    try:
        while line := (await reader.readline()).decode().strip():
            channel, _, payload = line.partition(" ")
            yield channel, payload
    finally:
        transport.close()
