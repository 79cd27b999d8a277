"""Keyframes of VP9, as its encoder marks them."""

from fractions import Fraction

import av
import numpy as np
import pytest

from streamkit_media.rtsp.rtspinput import is_vp9_keyframe


@pytest.mark.parametrize("profile", range(2))
def test_keyframes_are_those_of_the_encoder(profile: int) -> None:
    """Eight bits of each colour, which is what the encoder of FFmpeg's build makes."""
    pixel_format = ("yuv420p", "yuv444p")[profile]
    encoder = av.CodecContext.create("libvpx-vp9", "w")
    encoder.width, encoder.height, encoder.pix_fmt = 64, 48, pixel_format
    encoder.time_base, encoder.framerate = Fraction(1, 30), Fraction(30)
    encoder.options = {"g": "5", "deadline": "realtime", "cpu-used": "8", "profile": str(profile)}
    noise, packets = np.random.default_rng(1), []
    for index in range(20):
        pixels = noise.integers(0, 256, (48, 64, 3), np.uint8)
        frame = av.VideoFrame.from_ndarray(pixels, "rgb24").reformat(format=pixel_format)
        frame.pts = index
        packets += encoder.encode(frame)
    packets += encoder.encode(None)
    marked = [packet.is_keyframe for packet in packets]
    assert sum(marked) >= 3
    assert [is_vp9_keyframe(bytes(packet)) for packet in packets] == marked


@pytest.mark.parametrize(
    ("first_byte", "expected"),
    [(0x92, True), (0x96, False), (0xB1, True), (0xB3, False), (0x88, False), (0xB4, False)],
)
def test_keyframes_of_more_bits(first_byte: int, expected: bool) -> None:
    """Profile 2; profile 3, whose bits lie one further; a packet that shows an earlier frame again."""
    assert is_vp9_keyframe(bytes([first_byte, 0x49])) is expected


def test_an_empty_packet_is_none() -> None:
    """A server may send one."""
    assert not is_vp9_keyframe(b"")
