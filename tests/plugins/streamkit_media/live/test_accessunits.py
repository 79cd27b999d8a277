"""Frames joined from the payloads of RTP packets."""

import io
from collections.abc import Iterator
from fractions import Fraction
from types import ModuleType

import av
import pytest
from av.packet import Packet
from hypothesis import given
from hypothesis import strategies as st

from streamkit_media.live.accessunits import AccessUnits, DecodingTimes
from streamkit_media.nalunits import PARAMETER_SET_TYPES, SLICE_TYPES, typed_units

START = b"\0\0\0\1"
FRAGMENTS = {"h264": (28, 1), "h265": (49, 2)}


def piece_of(payload: bytes, codec: str, pts: int) -> Packet:
    """What FFmpeg makes of an RTP payload: units get start codes, fragments after the first come bare."""
    kind, header = FRAGMENTS[codec]
    found = payload[0] & 31 if codec == "h264" else payload[0] >> 1 & 63
    if found != kind:
        data = START + payload
    elif payload[header] & 0x80:
        first = (
            payload[0] & 0xE0 | payload[1] & 31
            if codec == "h264"
            else payload[0] & 0x81 | (payload[2] & 63) << 1
        )
        data = START + bytes([first]) + payload[1:header] + payload[header + 1 :]
    else:
        data = payload[header + 1 :]
    piece = Packet(data)
    piece.pts, piece.time_base = pts, Fraction(1, 90_000)
    return piece


def pieces_of(fake: ModuleType, units: list[bytes], codec: str) -> Iterator[tuple[Packet, bool]]:
    """The pieces of frames 3000 ticks apart, and whether each is the last of its frame."""
    for number, unit in enumerate(units):
        payloads = list(fake.rtp_payloads(unit, codec))
        for index, payload in enumerate(payloads):
            yield piece_of(payload, codec, 3000 * number), index == len(payloads) - 1


def plain(fake: ModuleType, data: bytes) -> list[bytes]:
    """The NAL units."""
    return fake.nal_units(data)


@pytest.fixture(autouse=True)
def _small_packets(fake: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Packets so small that every keyframe needs some."""
    monkeypatch.setattr(fake, "PAYLOAD_LIMIT", 40)


@pytest.fixture(scope="module", params=["h264", "h265"])
def video(request: pytest.FixtureRequest, fake: ModuleType) -> tuple[str, list[bytes]]:
    """A codec, and frames of it of which some are more than one packet long."""
    codec = str(request.param)
    return codec, fake.access_units((320, 240), count=20, codec="libx265" if codec == "h265" else "libx264")


@pytest.fixture
def joiner(video: tuple[str, list[bytes]]) -> Iterator[AccessUnits]:
    """Joins pieces of the video, as of a stream of 30 frames per second."""
    codec, units = video
    file = io.BytesIO()
    with av.open(file, "w", format="mpegts") as output:
        stream = output.add_mux_stream("hevc" if codec == "h265" else codec, width=320, height=240)
        for number, unit in enumerate(units):
            packet = Packet(unit)
            packet.stream, packet.time_base = stream, Fraction(1, 30)
            packet.pts = packet.dts = number
            output.mux_one(packet)
    file.seek(0)
    with av.open(file) as container:
        yield AccessUnits(container.streams.video[0])


def test_a_frame_is_whole_with_its_marked_piece(
    fake: ModuleType, video: tuple[str, list[bytes]], joiner: AccessUnits
) -> None:
    """Each frame comes out with its own last piece: all of its units, its time, whether it is key."""
    codec, units = video
    found: list[Packet] = []
    for piece, is_last in pieces_of(fake, units, codec):
        out = list(joiner.add(piece, is_marked=is_last))
        assert len(out) == is_last
        found += out
    assert [plain(fake, bytes(packet)) for packet in found] == [plain(fake, unit) for unit in units]
    assert [packet.pts for packet in found] == [3000 * number for number in range(20)]
    assert [packet.is_keyframe for packet in found] == [number % 15 == 0 for number in range(20)]
    assert {packet.duration for packet in found} == {3000}
    assert not list(joiner.drain())


def test_without_marks_the_next_frame_ends_one(
    fake: ModuleType, video: tuple[str, list[bytes]], joiner: AccessUnits
) -> None:
    """Where nothing is known of marks, the same frames come out, each with the first piece of the next."""
    codec, units = video
    found: list[Packet] = []
    for piece, _ in pieces_of(fake, units, codec):
        found += joiner.add(piece, is_marked=False)
    found += joiner.drain()
    assert [plain(fake, bytes(packet)) for packet in found] == [plain(fake, unit) for unit in units]


def test_frames_of_one_timestamp_are_distinguished(
    fake: ModuleType, video: tuple[str, list[bytes]], joiner: AccessUnits
) -> None:
    """Frames with one timestamp are separated where a first slice begins."""
    codec, units = video
    found: list[Packet] = []
    for piece, _ in pieces_of(fake, units, codec):
        piece.pts = 7
        found += joiner.add(piece, is_marked=False)
    found += joiner.drain()
    assert [plain(fake, bytes(packet)) for packet in found] == [plain(fake, unit) for unit in units]


def test_marks_on_every_packet_are_ignored(
    fake: ModuleType, video: tuple[str, list[bytes]], joiner: AccessUnits
) -> None:
    """Marks are ignored after the first frame that continues behind one; no byte is lost."""
    codec, units = video
    found: list[Packet] = []
    for piece, _ in pieces_of(fake, units, codec):
        found += joiner.add(piece, is_marked=True)
    found += joiner.drain()
    assert not joiner.trusts_marks
    whole = [plain(fake, bytes(packet)) for packet in found]
    assert whole[-10:] == [plain(fake, unit) for unit in units][-10:]
    assert sum(packet.size for packet in found) == sum(
        piece.size for piece, _ in pieces_of(fake, units, codec)
    )


def test_marked_parameter_sets_end_no_frame(
    fake: ModuleType, video: tuple[str, list[bytes]], joiner: AccessUnits
) -> None:
    """A mark on units that only precede a frame is ignored, and later marks still count."""
    codec, units = video
    found: list[Packet] = []
    nals = fake.nal_units(units[0])
    for index, nal in enumerate(nals):  # the last but one may be a slice, too
        found += joiner.add(piece_of(nal, codec, 0), is_marked=index != len(nals) - 2)
    assert [plain(fake, bytes(packet)) for packet in found] == [plain(fake, units[0])]
    assert joiner.trusts_marks


def test_parameter_sets_between_slices_do_not_divide_a_frame(
    fake: ModuleType, video: tuple[str, list[bytes]], joiner: AccessUnits
) -> None:
    """GStreamer's rtph264pay config-interval=-1 repeats them before each slice; a half would be damaged."""
    codec, units = video
    name = "hevc" if codec == "h265" else codec
    nals = [(next(typed_units(name, START + unit))[0], unit) for unit in fake.nal_units(units[0])]
    sets = [unit for kind, unit in nals if kind in PARAMETER_SET_TYPES[name]]
    first = next(unit for kind, unit in nals if kind in SLICE_TYPES[name])
    header = 1 if codec == "h264" else 2
    later = bytearray(first)
    later[header] &= 0x7F  # of the middle of the picture
    sent = [*sets, first, *sets, bytes(later)]
    found: list[Packet] = []
    for index, nal in enumerate(sent):
        found += joiner.add(piece_of(nal, codec, 0), is_marked=index == len(sent) - 1)
    assert [plain(fake, bytes(packet)) for packet in found] == [[*sets, first, bytes(later)]]


@given(st.integers(0, 4), st.integers(2, 60))
def test_decoding_times_ascend(reordered: int, count: int) -> None:
    """Once the order is known, decoding times ascend and none is later than its frame."""
    starts = range(0, count, reordered + 1)
    groups = [(start + reordered, *range(start, start + reordered)) for start in starts]
    shown = [number for group in groups for number in group]
    times = DecodingTimes()
    pairs = [(times.of(3000 * number), 3000 * number) for number in shown]
    settled = pairs[2 * (reordered + 1) :]
    assert all(decoded <= pts for decoded, pts in pairs)
    assert [decoded for decoded, _ in settled] == sorted(decoded for decoded, _ in settled)
