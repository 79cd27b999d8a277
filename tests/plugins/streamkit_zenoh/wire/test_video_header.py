"""The header of coded packets, and the codec strings of browsers."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit import Caps, Capture, Frame, FrameFlags
from streamkit_zenoh.wire.encodings import decode_json
from streamkit_zenoh.wire.video_header import VideoHeader, codec_string, video_header

H264, H265 = "video/x-h264", "video/x-h265"
AVCC = bytes.fromhex("0164001fffe1000467640 01f".replace(" ", "")) + b"\x01\x00\x02\x68\xee"
SPS = b"\0\0\0\1\x67\x4d\x40\x1f\x00" + b"\0\0\1\x68\xee"
# Profile, tier and level of x265's main profile at level 3.1: three zero bytes need emulation prevention.
HEVC_PROFILE = bytes.fromhex("0160000000900000000000") + b"\x5d"
HEVC_SPS = b"\0\0\0\1\x42\x01\x01" + bytes.fromhex("016000000300900000030000030 05d".replace(" ", "")) + b"\0"


@pytest.mark.parametrize(
    ("media_type", "codec_data", "packet", "expected"),
    [
        (H264, AVCC, b"", "avc1.64001f"),
        (H264, SPS, b"", "avc1.4d401f"),
        (H264, b"", SPS + b"\0\0\1\x65", "avc1.4d401f"),
        (H264, b"", b"\0\0\1\x65\x88", None),
        (H264, b"\x01\x64", b"", None),
        (H265, b"\x01" + HEVC_PROFILE + bytes(10), b"", "hev1.1.6.L93.90"),
        (H265, b"", HEVC_SPS, "hev1.1.6.L93.90"),
        (H265, b"", b"\0\0\1\x42\x01", None),
    ],
)
def test_codec_strings(media_type: str, codec_data: bytes, packet: bytes, expected: str | None) -> None:
    """They are those of RFC 6381, from boxes and from units with start codes; None where nothing is known."""
    assert codec_string(media_type, codec_data, packet) == expected


@given(st.sampled_from((H264, H265)), st.binary(max_size=64), st.binary(max_size=64))
def test_any_bytes_give_a_string_or_none(media_type: str, codec_data: bytes, packet: bytes) -> None:
    """Parameter sets come from cameras: damaged ones do no harm."""
    found = codec_string(media_type, codec_data, packet)
    assert found is None or found.startswith(("avc1.", "hev1."))


def test_a_keyframe_carries_codec_and_parameter_sets() -> None:
    """Other packets do not; times are those of the frame."""
    caps = Caps(f"{H264}, width=640, height=480, codec_data={AVCC.hex()}")
    frame = Frame(
        b"\0\0\0\1\x65", caps, pts=40, duration=20, seq=7, epoch=1, flags=FrameFlags.KEYFRAME,
        capture=Capture(123, "rtcp"),
    )  # fmt: skip
    header = decode_json(video_header(frame, "uav/1", 456), VideoHeader)
    assert header.keyframe
    assert (header.codec, header.width, header.height) == ("avc1.64001f", 640, 480)
    assert (header.pts_ns, header.duration_ns, header.capture_ns, header.published_ns) == (40, 20, 123, 456)
    assert (header.seq, header.epoch, header.source) == (7, 1, "uav/1")
    assert header.codec_data is not None
    other = decode_json(video_header(frame.replace(flags=0), "uav/1", 456), VideoHeader)
    assert (other.keyframe, other.codec, other.codec_data) == (False, None, None)


def test_an_invalid_header_is_refused() -> None:
    """A field of the wrong type, an endless text, or an unknown field nested without end."""
    good = msgspec.json.decode(video_header(Frame(b"", Caps(H264)), "a", 1))
    for change in ({"pts_ns": "1"}, {"schema": "streamkit.video/2"}, {"codec": "x" * 100}):
        with pytest.raises(ValueError):  # noqa: PT011
            decode_json(msgspec.json.encode(good | change), VideoHeader)
    nested = video_header(Frame(b"", Caps(H264)), "a", 1)[:-1] + b',"more":' + b"[" * 100_000
    with pytest.raises(ValueError, match="recursion"):
        decode_json(nested, VideoHeader)


def test_the_header_says_how_the_frame_is_to_be_turned() -> None:
    """As the caps do, in each packet; the size is that of the packet's frame."""
    caps = Caps(f"{H264}, width=640, height=480, rotation=90, flipped=true")
    header = decode_json(video_header(Frame(b"", caps), "uav/1", 456), VideoHeader)
    assert (header.rotation, header.flipped, header.width, header.height) == (90, True, 640, 480)
    upright = video_header(Frame(b"", Caps(H264)), "uav/1", 456)
    assert b"rotation" not in upright
    assert b"flipped" not in upright
