"""The contract that every log format keeps, whatever it is."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fusion.errors import EmptyLogError, LogError
from fusion.formats import FORMATS, read_log
from fusion.types import DriveLog, no_progress
from log_support import same

FUZZ = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def test_every_format_has_a_sample_and_a_matching_name(samples: dict[str, bytes]) -> None:
    assert all(samples[name] for name in FORMATS)  # says what to add where there is none
    assert set(samples) == set(FORMATS), "a sample of no format of fusion/formats/__init__.py"
    assert all(name == f.name and f.description and f.suffixes for name, f in FORMATS.items())


def test_a_format_without_a_sample_fails_with_what_to_add(samples: dict[str, bytes]) -> None:
    with pytest.raises(AssertionError, match=r"'another'.*tests/support/log_samples\.py.*1\.8 to 1\.9 E"):
        samples["another"]


@pytest.mark.parametrize("name", list(FORMATS))
def test_every_format_advises_in_one_sentence(name: str) -> None:
    for advice in (FORMATS[name].altitude_advice, FORMATS[name].doppler_advice):
        assert advice[:1].isupper() and advice.endswith(".") and ". " not in advice, advice


@pytest.mark.parametrize("name", list(FORMATS))
def test_recognises_its_own_sample_and_no_other(samples: dict[str, bytes], name: str) -> None:
    assert FORMATS[name].recognises(samples[name])  # a format without a sample is told so
    assert [n for n, sample in samples.items() if FORMATS[name].recognises(sample)] == [name]


def holds_a_drive(log: DriveLog) -> bool:
    """Whether it has positions, or what they can be made of."""
    return len(log.fix) >= 1 or (log.raw is not None and len(log.raw.signals) >= 1)


@pytest.mark.parametrize("name", list(FORMATS))
def test_reads_its_sample_into_a_sound_log(samples: dict[str, bytes], name: str) -> None:
    log = read_log(samples[name])
    assert log.source_format == name
    assert holds_a_drive(log)
    if len(log.fix):
        west, south, east, north = log.bounds_deg()
        assert (1.8 < west <= east < 1.9) and (50.9 < south <= north < 51)
    assert not log.missing or all(isinstance(m, str) for m in log.missing)


@pytest.mark.parametrize("name", list(FORMATS))
def test_truncated_anywhere_it_reads_or_raises_a_log_error(samples: dict[str, bytes], name: str) -> None:
    sample = samples[name]
    for cut in np.unique(np.linspace(0, len(sample) - 1, 120).astype(int)):
        try:
            log = read_log(sample[:cut])
        except LogError as error:
            assert str(error).rstrip().endswith(".")
        else:
            assert holds_a_drive(log)


@pytest.mark.parametrize("name", list(FORMATS))
@pytest.mark.parametrize("put", [b"\x80", b"\xc3", b"\x00"])
def test_bytes_that_are_no_text_anywhere_read_or_raise_a_log_error(
    samples: dict[str, bytes], name: str, put: bytes
) -> None:
    sample = samples[name]
    for at in np.unique(np.linspace(0, len(sample) - 1, 60).astype(int)):
        with contextlib.suppress(LogError):
            assert holds_a_drive(read_log(sample[:at] + put + sample[at:]))


@pytest.mark.parametrize("name", list(FORMATS))
# the samples' text would hide what failed
@pytest.mark.filterwarnings("ignore:Generating overly large repr")
@FUZZ
@given(
    damage=st.lists(
        st.tuples(st.integers(0, 5999), st.integers(0, 4), st.binary(max_size=6)), min_size=1, max_size=20
    )
)
def test_damaged_it_reads_or_raises_a_log_error(
    samples: dict[str, bytes], name: str, damage: list[tuple[int, int, bytes]]
) -> None:
    sample = bytearray(samples[name][:6000])
    for place, gone, put in damage:
        at = place % len(sample)
        sample[at : at + gone] = put
    for reader in (read_log, lambda b: FORMATS[name].read(b, no_progress)):
        with contextlib.suppress(LogError):
            assert holds_a_drive(reader(bytes(sample)))


@FUZZ
@given(st.one_of(st.binary(max_size=3000), st.text(max_size=500).map(str.encode)))
def test_random_bytes_raise_nothing_but_log_errors(blob: bytes) -> None:
    for lead in (
        b"",
        b"\x1f\x8b",
        b"\xb5\x62",
        b"$GNRMC,",
        b"<gpx>",
        b"time_s,lat_deg,lon_deg\n",
        b"\xff\xfe",
        f"{'     3.04           OBSERVATION DATA    M':60}RINEX VERSION / TYPE\n".encode(),
        f"{'3.0                 COMPACT RINEX FORMAT':60}CRINEX VERS   / TYPE\n".encode(),
        b"# Raw,TimeNanos,ReceivedSvTimeNanos\n",
        b"time_s,sv,pseudorange_m\n",
        b"PK\x03\x04",
    ):
        with pytest.raises(LogError):
            read_log(lead + blob)


def test_an_absurd_time_is_named_in_few_digits() -> None:
    with pytest.raises(EmptyLogError, match=r"the time is 1e\+300 s, outside") as caught:
        read_log(b"time_s,lat_deg,lon_deg\n1e300,49,8\n")
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
def test_disorder_of_the_positions_is_said(samples: dict[str, bytes], order: slice) -> None:
    header, *rows = samples["csv"].splitlines()
    log = read_log(b"\n".join([header, *rows[order]]))
    assert same(log, read_log(samples["csv"]))
    said = [w for w in log.warnings if "sorted by time" in w]
    assert said == (
        []
        if order.step is None
        else [f"{len(rows) - 1} of the positions stand before an earlier one: they were sorted by time."]
    )


def test_a_missing_file_is_a_log_error_and_progress_may_abort(
    samples: dict[str, bytes], tmp_path: Path
) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "none.csv")

    def stop(stage: str, share: float) -> None:
        raise KeyboardInterrupt

    for sample in samples.values():
        with pytest.raises(KeyboardInterrupt):
            read_log(sample, progress=stop)


def test_the_shared_comma2k19_log_reads(shared_data: Path) -> None:
    log = read_log(shared_data / "comma2k19" / "log.csv")
    assert (len(log.fix), len(log.force), len(log.rate), len(log.odometry)) == (579, 579, 579, 579)
    assert not log.skipped and not log.warnings
    assert np.nanmean(log.force.acc_z_mps2) == pytest.approx(9.8, abs=0.3)
    assert np.hypot(log.velocity.vel_n_mps[0], log.velocity.vel_e_mps[0]) == pytest.approx(7.823)
    assert log.fix.has("height_ell_m") and not log.fix.has("alt_msl_m")


def test_empty_logs_say_what_was_wrong() -> None:
    with pytest.raises(EmptyLogError, match=r"line 2: lat_deg is 91"):
        read_log(b"time_s,lat_deg,lon_deg\n1525448060,91,8\n")
