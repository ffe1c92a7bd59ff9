"""Phones that send by themselves: their keys, where they are, and a batch of points over HTTP."""

from __future__ import annotations

import asyncio
import json
import uuid

import psycopg

from app.access.store import hashed, new_key

PATIENCE_S, PLACE_EVERY_S = 30.0, 5.0


def make_keys(url: str, devices: int) -> list[str]:
    """An owner with an address for each device; the secrets."""
    secrets = [new_key() for _ in range(devices)]
    with psycopg.connect(url) as connection:
        owner = "INSERT INTO owners (name) VALUES ('fleet') RETURNING id"
        (owner_id,) = connection.execute(owner).fetchone() or (0,)
        columns = "COPY keys (id, owner_id, label, scope, secret_sha256) FROM STDIN"
        with connection.cursor() as cursor, cursor.copy(columns) as rows:
            for number, secret in enumerate(secrets):
                rows.write_row((uuid.uuid4(), owner_id, f"phone {number}", "live", hashed(secret)))
    return secrets


def place(device: int, at: int) -> tuple[float, float]:
    """Where a device is at its so many-th point: each on a road of its own, some metres a second."""
    return 47.0 + device % 100 * 0.02 + at * 0.0006, 6.0 + device // 100 * 0.02


def batch(device: int, number: int, points: int, began_s: int) -> bytes:
    """The body of a batch."""
    features = []
    for at in range(number * points, (number + 1) * points):
        lat, lon = place(device, at)
        moment = began_s + at * PLACE_EVERY_S
        properties = {"timestamp": moment, "altitude": 300.0, "speed": 13.0, "horizontal_accuracy": 4.0}
        geometry = {"type": "Point", "coordinates": [lon, lat]}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return json.dumps({"locations": features}).encode()


async def post(port: int, secret: str, body: bytes) -> bool:
    """Send a batch on a connection of its own; whether it was answered well."""
    head = (
        f"POST /v1/live/overland/{secret} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(body)}\r\nConnection: close\r\n\r\n"
    )
    try:
        async with asyncio.timeout(PATIENCE_S):
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            try:
                writer.write(head.encode() + body)
                answer = await reader.read()
            finally:
                writer.close()
    except (OSError, TimeoutError):
        return False
    return answer.startswith(b"HTTP/1.1 200") and answer.endswith(b'{"result": "ok"}')
