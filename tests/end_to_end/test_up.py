"""``versant up`` as a tree of processes: it stops altogether, and it survives what happens to its parts."""

from __future__ import annotations

import os
import re
import signal

import httpx
import pytest

from fusion.simulate.demonstration import Demonstration
from tests.end_to_end.conftest import PROC, STOP_S, Up, await_true, versant

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not (PROC / "self/environ").exists(), reason="counts processes by /proc"),
]


def test_a_drive_is_taken_up_again_after_ctrl_c_and_nothing_outlives_a_killed_parent(
    idle: Up, simulated: Demonstration
) -> None:
    idle.start()
    assert "Only this machine can reach it" in idle.said()
    link = re.search(rf"The map: {idle.address}/login#link=(\S+)  ", idle.said())
    assert link is not None
    for status in (200, 401):  # it logs one browser in, once
        answer = httpx.post(f"{idle.address}/v1/session", json={"link": link[1]}, trust_env=False)
        assert answer.status_code == status, answer.text
    assert httpx.get(f"{idle.address}/v1/drives", trust_env=False).status_code == 401
    key = idle.key
    for command, file in (("import-roads", simulated.osm), ("import-dem", simulated.dem)):
        assert versant(command, "--data-dir", idle.data_dir, file).returncode == 0
    with idle.client() as client:
        # Large enough to be still at work when the interrupt comes.
        drive = client.upload(simulated.drives[0], method="particle", options={"particles": 25_000})
        await_true(lambda: client.drive(drive.id).status == "running", 30, "the drive never began")
    assert idle.interrupt() == 0, idle.said()
    assert idle.processes() == []
    assert "Traceback" not in idle.said()

    idle.start()
    with idle.client() as client:
        assert client.wait(drive.id, timeout_s=150).status == "done"
    idle.process.kill()
    idle.process.wait()
    await_true(
        lambda: not idle.processes("app.cli", "worker") and not idle.processes("app.cli", "api"),
        STOP_S,
        "API or worker outlived their parent",
    )
    idle.start()
    assert idle.key == key
    assert idle.interrupt() == 0
    assert idle.processes() == []


def test_a_killed_worker_is_replaced_and_a_killed_database_started_again(
    idle: Up, simulated: Demonstration
) -> None:
    idle.start()
    assert versant("import-roads", "--data-dir", idle.data_dir, simulated.osm).returncode == 0
    workers = idle.processes("app.cli", "worker")
    os.kill(workers[0], signal.SIGKILL)
    # A lane of the old one, forked late, is a new process too: what was said is waited for first.
    ended = r"the worker(s| 1)? ended with status -9"
    await_true(lambda: re.search(ended, idle.said()), 30, "nobody noticed")
    await_true(lambda: set(idle.processes("app.cli", "worker")) - set(workers), 30, "no new worker")

    postmaster = int((idle.data_dir / "postgres" / "data" / "postmaster.pid").read_text().split()[0])
    os.kill(postmaster, signal.SIGKILL)
    await_true(lambda: "PostgreSQL ended by itself" in idle.said(), 30, "nobody noticed")
    with idle.client() as client:
        drive = client.upload(simulated.drives[0], method="raw")
        assert client.wait(drive.id, timeout_s=150).status == "done"
    assert idle.said().count("PostgreSQL ended by itself") == 1
    assert idle.interrupt() == 0, idle.said()
    assert idle.processes() == []


def test_a_taken_port_is_said_in_one_line(running: Up) -> None:
    port = running.address.rsplit(":", 1)[1]
    second = versant("up", "--data-dir", running.data_dir, "--port", port)
    assert second.returncode == 1
    complaint = [line for line in second.stderr.splitlines() if line.startswith("versant:")]
    assert len(complaint) == 1
    assert "--port" in complaint[0]
    assert "Traceback" not in second.stderr
    with running.client() as client:
        assert client.get("/readyz").is_success
