"""What the benchmark under attack counts, and that its inputs are as small and as large as they say."""

from __future__ import annotations

import gzip
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import rasterio

from fusion.formats import read_log
from hostile import __main__ as hostile
from hostile import inputs
from hostile.attempts import ATTACKS, Attack
from hostile.well_behaved import Answer, Client, Served, longest_away, request, served
from service.watching import descendants, pss_mb


class _Quick(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Length", "2")
        self.end_headers()
        self.wfile.write(b"ok")

    def log_message(self, *_: object) -> None:
        """Says nothing."""


@pytest.fixture
def port() -> Iterator[int]:
    """A server that answers every GET."""
    with ThreadingHTTPServer(("127.0.0.1", 0), _Quick) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


def seen(*answers: tuple[float, float, int]) -> list[Answer]:
    return [Answer(*answer) for answer in answers]


def test_away_is_from_the_first_refusal_to_the_next_answer() -> None:
    assert longest_away(seen((0, 0.1, 200), (1, 0.1, 503), (2, 0.1, 0), (3, 0.5, 200)), 9.0) == 2.5
    assert longest_away(seen((0, 0.1, 503), (1, 0.1, 404), (5, 0.1, 503)), 9.0) == 4.0, "it lasts at the end"
    assert longest_away(seen((0, 0.1, 200), (1, 8.0, 422)), 9.0) == 0.0, "slow is not away"


def test_what_is_beyond_the_bounds_is_told() -> None:
    good = served(seen(*((k, 0.01, 200) for k in range(100))), 100.0)
    slow = served(seen(*((k, 2.5, 200) for k in range(100))), 100.0)
    gone = served(seen((0, 0.1, 503), (6, 0.1, 200)), 7.0)
    assert (good.requests, good.turned_away, dict(good.statuses)) == (100, 0, {"200": 100})
    assert row(items=good).faults == []
    assert row(items=slow).faults == ["it: p99 of items is 2.50 s"]
    assert row(tile=gone, items=good).faults == ["it: tile was turned away for 6.1 s"]
    assert hostile.judgement([row(items=good)], {"failed": 1}) == ["1 of the client's drives: failed"]
    assert hostile.report([row(items=good)], [])[-1] == "Good."


def row(**kinds: Served) -> hostile.Row:
    return hostile.Row("it", kinds, 3, 3, {"api": 100.0}, {"it": {"200": 1}})


def test_kinds_that_were_never_asked_for_are_faults() -> None:
    """A client that could not even ask is not one that was served well."""
    assert row(items=served([], 1.0)).faults == ["it: p99 of items is nan s"]


def test_a_client_notes_who_does_not_answer() -> None:
    with closing(socket.socket()) as taken:
        taken.bind(("127.0.0.1", 0))  # nobody listens
        client = Client(taken.getsockname()[1], "8,49,9,50", "14/1/1", iter(()))
        assert client.ask("items", "GET", "/") == (0, b"")
    assert client.results()["items"].statuses == {"none": 1}


def test_an_attacker_counts_what_it_is_answered(port: int, tmp_path: Path) -> None:
    attack = Attack(port, "127.0.0.1", 30.0, tmp_path)
    attack.ask("GET", "/")
    attack.ask("POST", "/")
    assert attack.outcomes == {"200": 1, "501": 1}
    assert request(port, "GET", "/") == (200, b"ok")


def test_connections_that_the_service_ends_are_made_anew(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        attack = Attack(server.getsockname()[1], "127.0.0.1", 20.0, tmp_path)
        thread = threading.Thread(target=attack.hold, args=(1, lambda _: b"GET / HTTP/1.1\r\n"))
        thread.start()
        for _ in range(2):
            server.accept()[0].close()
        with server.accept()[0] as third:
            assert third.recv(100) == b"GET / HTTP/1.1\r\n"
            attack.ends_s = 0.0
            thread.join()
    assert attack.outcomes == {"connected": 3, "ended by the service": 2}


def test_small_inputs_stand_for_large_ones(tmp_path: Path) -> None:
    sparse = inputs.sparse_raster(tmp_path)
    assert len(sparse) < 20_000
    with rasterio.open(tmp_path / "sparse.tif") as raster:
        assert raster.shape == (400_000, 400_000)
    packed = inputs.bomb(4 * inputs.BOMB_PIECE_BYTES)
    assert len(packed) < 200_000
    assert len(gzip.decompress(packed)) == 4 * inputs.BOMB_PIECE_BYTES
    (tmp_path / "rows.csv.gz").write_bytes(inputs.many_rows(500))
    assert len(read_log(tmp_path / "rows.csv.gz").fix.time_s) == 500


def test_a_forked_process_is_looked_at_as_well() -> None:
    """It has its parent's command line."""
    code = "import os, time; os.fork() or os.fork(); print(flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        for _ in range(3):
            parent.stdout.readline()
        found = descendants(parent.pid)
        try:
            assert len(found) == 2
            assert all(pss_mb(pid) > 0.5 for pid in (parent.pid, *found))
        finally:
            for pid in (parent.pid, *found):
                os.kill(pid, signal.SIGKILL)
    assert pss_mb(parent.pid) == 0.0


def test_every_attack_says_what_it_is() -> None:
    for name, attack in ATTACKS.items():
        assert attack.__doc__, name
        assert f"    {name} " in str(hostile.__doc__), name
