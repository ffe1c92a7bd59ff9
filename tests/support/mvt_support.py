"""A decoder of Mapbox vector tiles of its own, so that PostGIS is not checked against itself."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any

EXTENT = 4096


def varint(data: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """(field number, value) of a protobuf message: integers, or bytes of fixed and delimited fields."""
    at = 0
    while at < len(data):
        key, at = varint(data, at)
        match key & 7:
            case 0:
                value, at = varint(data, at)
                yield key >> 3, value
                continue
            case 1:
                size = 8
            case 5:
                size = 4
            case _:
                size, at = varint(data, at)
        yield key >> 3, data[at : at + size]
        at += size


def packed(data: bytes) -> list[int]:
    values, at = [], 0
    while at < len(data):
        value, at = varint(data, at)
        values.append(value)
    return values


def zigzag(value: int) -> int:
    return (value >> 1) ^ -(value & 1)


def value_of(data: bytes) -> Any:
    ((number, value),) = fields(data)
    match number:
        case 1:
            return value.decode()
        case 2:
            return struct.unpack("<f", value)[0]
        case 3:
            return struct.unpack("<d", value)[0]
        case 6:
            return zigzag(value)
        case 7:
            return bool(value)
        case _:
            return value


def layers(tile: bytes) -> dict[str, list[dict[str, Any]]]:
    """Layer's name -> its features: id, properties, path in tile coordinates."""
    out = {}
    for number, layer in fields(tile):
        assert number == 3
        parts: dict[int, list[Any]] = {}
        for field, value in fields(layer):
            parts.setdefault(field, []).append(value)
        keys = [key.decode() for key in parts.get(3, [])]
        values = [value_of(value) for value in parts.get(4, [])]
        assert parts[15] == [2], "version 2 of the specification"
        assert parts[5] == [EXTENT]
        out[parts[1][0].decode()] = [decoded(f, keys, values) for f in parts[2]]
    return out


def decoded(feature: bytes, keys: list[str], values: list[Any]) -> dict[str, Any]:
    found = dict(fields(feature))
    tags = packed(found[2])
    commands, path, x, y = packed(found[4]), [], 0, 0
    assert found[3] in (1, 2), "points or lines"
    at = 0
    while at < len(commands):
        count, at = commands[at] >> 3, at + 1
        for _ in range(count):
            x, y = x + zigzag(commands[at]), y + zigzag(commands[at + 1])
            path.append((x, y))
            at += 2
    properties = {keys[k]: values[v] for k, v in zip(tags[::2], tags[1::2], strict=True)}
    return {"id": found.get(1), "properties": properties, "path": path}


def features(tile: bytes) -> dict[int, str]:
    """What is in a tile of one layer, in whatever order: each feature by its id."""
    ((_, found),) = layers(tile).items() if tile else (("", []),)
    return {feature["id"]: repr(feature) for feature in found}
