import math
import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit_telemetry_formats.klv import KEY_PREFIX, UAS_LOCAL_SET, UNIVERSAL_SET, checksum
from streamkit_telemetry_formats.misb import MisbTelemetry
from streamkit_telemetry_formats.sample import Sample

POSITION = b"\x0d\x04\x10\x00\x00\x00\x0e\x04\x10\x00\x00\x00"


def ber(size: int) -> bytes:
    """A BER length."""
    return bytes([size]) if size < 128 else b"\x82" + size.to_bytes(2, "big")


def local_set(value: bytes) -> bytes:
    """A UAS local set with a good checksum."""
    data = UAS_LOCAL_SET + ber(len(value) + 4) + value + b"\x01\x02"
    return data + checksum(data).to_bytes(2, "big")


def element(tag: int, value: bytes) -> bytes:
    """An element of a local set."""
    head = bytes([tag]) if tag < 128 else bytes([0x80 | tag >> 7, tag & 0x7F])
    return head + ber(len(value)) + value


def universal_set(**values: bytes) -> bytes:
    """A universal set; values by the last twelve bytes of their key in hexadecimal digits."""
    elements = b"".join(
        KEY_PREFIX + bytes.fromhex(key[1:]) + ber(len(value)) + value for key, value in values.items()
    )
    return UNIVERSAL_SET + ber(len(elements)) + elements


LATITUDE, LONGITUDE, ALTITUDE = (
    "k010101030701020102040200",
    "k010101030701020102060200",
    "k010101010701020102020000",
)
TIME, HEADING, FIELD = "k010101010702010101050000", "k010101070701100106000000", "k010101020420020101080000"


def test_an_unsized_integer_of_128_bytes_is_left_out() -> None:
    """A number too large for a float costs only itself, and is counted."""
    telemetry = MisbTelemetry()
    (sample,) = telemetry.feed(local_set(POSITION + element(8, b"\xff" * 128)), 5)
    assert sample.pts == 5
    assert (telemetry.reader.good, telemetry.broken_tags) == (1, 1)


hostile_values = st.one_of(
    st.binary(max_size=12),
    st.integers(100, 400).map(lambda size: b"\xff" * size),
    st.sampled_from([b"\x80" + bytes(3), b"\x7f" + b"\xff" * 7, b"\xff" * 8, b"\x80" + bytes(7)]),
)
hostile_sets = st.lists(st.builds(element, st.integers(1, 160), hostile_values), max_size=40)


@settings(max_examples=400)
@given(st.lists(st.tuples(hostile_sets, st.one_of(st.none(), st.integers(0, 2**62))), max_size=5))
def test_hostile_packets_with_good_checksums(packets: list[tuple[list[bytes], int | None]]) -> None:
    """Any tags and lengths of a well-formed packet give samples of finite numbers, or a count."""
    telemetry = MisbTelemetry()
    samples = []
    for elements, pts in packets:
        samples += telemetry.feed(local_set(POSITION + b"".join(elements)), pts)
    assert telemetry.reader.good + telemetry.reader.bad == len(packets)
    assert all(is_sound(sample) for sample in samples)


def is_sound(sample: Sample) -> bool:
    """Whether the coordinates of a sample are valid, and all its numbers are finite."""
    numbers = (sample.altitude, sample.heading, sample.pitch, sample.roll, *(sample.sensor_angles or ()))
    utc_is_sound = sample.utc_ns is None or 0 <= sample.utc_ns < 2**63
    is_on_earth = abs(sample.latitude) <= 90 and abs(sample.longitude) <= 180
    return utc_is_sound and is_on_earth and all(n is None or math.isfinite(n) for n in numbers)


def test_the_universal_set() -> None:
    """The set of older aircraft: doubles and floats, degrees, its time in microseconds."""
    data = universal_set(
        **{
            TIME: (1_200_000_000_000_000).to_bytes(8, "big"),
            LATITUDE: struct.pack(">d", 34.5),
            LONGITUDE: struct.pack(">d", -118.25),
            ALTITUDE: struct.pack(">f", 2500.5),
            HEADING: struct.pack(">f", 90.0),
            FIELD: struct.pack(">f", 45.0),
        }
    )
    telemetry = MisbTelemetry()
    (sample,) = telemetry.feed(data, 7)
    assert (sample.pts, sample.latitude, sample.longitude, sample.altitude) == (7, 34.5, -118.25, 2500.5)
    assert sample.heading == math.pi / 2
    assert sample.utc_ns == 1_200_000_000_000_000_000
    assert sample.source == "misb above sea level"
    assert (telemetry.reader.good, telemetry.reader.bad, telemetry.reader.skipped) == (1, 0, 0)


def test_a_damaged_universal_set_is_refused_and_the_next_found() -> None:
    """Without a checksum the form has to fit: a changed length inside costs one packet."""
    place = {LATITUDE: struct.pack(">d", 1.0), LONGITUDE: struct.pack(">d", 2.0)}
    good, broken = universal_set(**place), bytearray(universal_set(**place))
    broken[17 + 16] = 9
    telemetry = MisbTelemetry()
    samples = telemetry.feed(bytes(broken) + good, 0) + telemetry.finish(0)
    assert len(samples) == 1
    assert telemetry.reader.bad == 1
    assert telemetry.reader.skipped == len(broken)


def test_numbers_of_the_universal_set_have_their_range() -> None:
    """Infinities and places that are not on earth are left out and counted."""
    place = {LATITUDE: struct.pack(">d", 1.0), LONGITUDE: struct.pack(">d", 2.0)}
    telemetry = MisbTelemetry()
    (sample,) = telemetry.feed(universal_set(**place, **{ALTITUDE: struct.pack(">f", math.inf)}), 0)
    assert sample.altitude is None
    assert telemetry.feed(universal_set(**{**place, LATITUDE: struct.pack(">d", math.nan)}), 10**12) == []
    assert telemetry.feed(universal_set(**{**place, LONGITUDE: b"\0" * 5}), 2 * 10**12) == []
    assert telemetry.broken_tags == 3


@given(
    st.dictionaries(st.sampled_from([TIME, LATITUDE, LONGITUDE, ALTITUDE, HEADING]), st.binary(max_size=20))
)
def test_hostile_universal_sets(values: dict[str, bytes]) -> None:
    """Any values of any length give samples of finite numbers, or a count."""
    telemetry = MisbTelemetry()
    assert all(is_sound(sample) for sample in telemetry.feed(universal_set(**values), None))
    assert telemetry.reader.good == bool(values)


def test_the_platforms_clock_serves_where_the_stream_has_no_times() -> None:
    """The first packet's time is zero; tags then stay good for five seconds of that clock."""

    def clock(seconds: int) -> bytes:
        return element(2, (10**15 + seconds * 10**6).to_bytes(8, "big"))

    telemetry = MisbTelemetry()
    data = local_set(clock(0) + POSITION) + local_set(clock(3)) + local_set(clock(9)) + local_set(POSITION)
    assert [sample.pts for sample in telemetry.feed(data, None)] == [0, 3 * 10**9]
    assert telemetry.reader.good - telemetry.poses == 2
