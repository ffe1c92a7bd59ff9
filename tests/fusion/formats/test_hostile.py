"""Every reader meets what is cut, turned, empty, huge or endless: it yields a log or a ``LogError``, and soon."""

from __future__ import annotations

import gzip
import time
from functools import partial
from random import Random

import numpy as np
import pytest

from fusion.errors import LogError
from fusion.formats import FORMATS, HEAD_BYTES, read_log, refuse_head
from fusion.types import DriveLog, no_progress

SOON_S = 2.0
"""Of processor time, for samples of some kilobytes."""
TEXT = [name for name in FORMATS if name not in {"ubx", "fit"}]
HUGE = (b"1e308", b"9" * 400, b"NaN", b"\xd9\xa3", b"")


@pytest.fixture(scope="module", autouse=True)
def warm(samples: dict[str, bytes]) -> None:
    """What a process compiles at its first log is no matter of the input."""
    for sample in samples.values():
        read_log(sample)


def sound(blob: bytes, name: str) -> None:
    """Both ways in keep the contract: the recognised one, and the reader asked for by name."""
    began = time.process_time()
    for reader in (read_log, partial(FORMATS[name].read, progress=no_progress)):
        try:
            log = reader(blob)
        except LogError as error:
            assert str(error).rstrip().endswith((".", "?"))
        else:
            assert isinstance(log, DriveLog)
            assert all(np.all(np.diff(table.time_s) > 0) for table in log.tables().values())
            assert not np.any(np.abs(log.fix.lat_deg) > 90) and not np.any(np.abs(log.fix.lon_deg) > 180)
    assert time.process_time() - began < SOON_S


@pytest.mark.parametrize("name", list(FORMATS))
@pytest.mark.parametrize("tenth", range(10))
def test_cut_at_every_tenth(samples: dict[str, bytes], name: str, tenth: int) -> None:
    sample = samples[name]
    at = len(sample) * tenth // 10
    sound(sample[:at], name)
    sound(sample[at:], name)
    packed = gzip.compress(sample)
    sound(packed[: len(packed) * tenth // 10], name)


@pytest.mark.parametrize("name", list(FORMATS))
@pytest.mark.parametrize("seed", range(4))
def test_bits_that_turned(samples: dict[str, bytes], name: str, seed: int) -> None:
    random = Random(seed)  # noqa: S311 - no secret
    sample = bytearray(samples[name])
    for _ in range(random.choice([1, 5, 50, len(sample) // 20])):
        sample[random.randrange(len(sample))] ^= 1 << random.randrange(8)
    sound(bytes(sample), name)


@pytest.mark.parametrize("name", TEXT)
@pytest.mark.parametrize("cell", HUGE, ids=lambda cell: cell[:12].decode("latin-1"))
def test_numbers_that_cannot_be(samples: dict[str, bytes], name: str, cell: bytes) -> None:
    """In the place of every number of a line, one after the other."""
    lines = samples[name].split(b"\n")
    row = len(lines) // 2
    digits = np.frombuffer(lines[row] + b" ", np.uint8)
    inside = (digits >= ord("0")) & (digits <= ord("9"))
    starts = np.flatnonzero(inside & ~np.concatenate([[False], inside[:-1]]))
    for start in starts[:: max(1, len(starts) // 6)]:
        end = start + int(np.argmin(inside[start:]))
        changed = lines[row][:start] + cell + lines[row][end:]
        sound(b"\n".join([*lines[:row], changed, *lines[row + 1 :]]), name)


@pytest.mark.parametrize("name", TEXT)
@pytest.mark.parametrize("filling", [b"1", b",", b" ", b'"', b"<a>"])
def test_lines_without_end(samples: dict[str, bytes], name: str, filling: bytes) -> None:
    lines = samples[name].split(b"\n")
    long = filling * (100_000 // len(filling))
    row = len(lines) // 2
    sound(b"\n".join([*lines[:row], lines[row] + long, *lines[row + 1 :]]), name)
    sound(long + b"\n" + samples[name], name)


@pytest.mark.parametrize("name", list(FORMATS))
@pytest.mark.parametrize("blob", [b"", b"\n", b"\x00" * 5000, b" " * 5000, b"\xef\xbb\xbf", b"\xff\xfe"])
def test_nothing_at_all_is_no_log(name: str, blob: bytes) -> None:
    assert not FORMATS[name].recognises(blob)
    sound(blob, name)
    with pytest.raises(LogError):
        read_log(blob)


@pytest.mark.parametrize("name", list(FORMATS))
def test_the_first_look_refuses_no_log_that_is_read(samples: dict[str, bytes], name: str) -> None:
    sample = samples[name]
    refuse_head(sample[:HEAD_BYTES])
    refuse_head(sample[:HEAD_BYTES], part=True)
    for tenth in range(1, 10):
        cut = sample[: len(sample) * tenth // 10]
        try:
            read_log(cut)
        except LogError:
            continue
        refuse_head(cut)
