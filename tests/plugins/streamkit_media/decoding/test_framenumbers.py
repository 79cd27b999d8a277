from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from streamkit_media.decoding.framenumbers import FrameNumbers

COUNT, GOP = 40, 20
Packets = list[tuple[bytes, bool]]


def encoded(options: dict[str, str], pixel_format: str = "yuv420p") -> tuple[Packets, bytes]:
    """Packets of a moving ramp with whether each is a keyframe, and the extradata."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt = 64, 48, pixel_format
    encoder.time_base, encoder.framerate = Fraction(1, 30), Fraction(30)
    encoder.options = {"g": str(GOP), "sc_threshold": "0", "threads": "1", **options}
    encoder.open()
    packets = []
    rows, columns = np.mgrid[:48, :64]
    for index in range(COUNT):
        pixels = np.full((72, 64), 128, np.uint8)
        pixels[:48] = 40 + (rows * columns + 7 * index) % 160
        video_frame = av.VideoFrame.from_ndarray(pixels, "yuv420p").reformat(format=pixel_format)
        video_frame.pts = index
        packets += encoder.encode(video_frame)
    packets += encoder.encode(None)
    return [(bytes(packet), packet.is_keyframe) for packet in packets], encoder.extradata or b""


def is_reference(data: bytes) -> bool:
    """Whether others may be built on the last slice of a packet in Annex B form."""
    return bool(data[data.rfind(b"\0\0\1") + 3] & 0x60)


STREAMS = {
    "baseline": ({"profile": "baseline"}, "yuv420p"),
    "main": ({"bf": "0"}, "yuv420p"),
    "B-frames": ({"bf": "3", "b-pyramid": "strict"}, "yuv420p"),
    "high with scaling lists": ({"x264-params": "cqm=jvt"}, "yuv420p"),
    "4:4:4": ({"bf": "0"}, "yuv444p"),
    "interlaced": ({"flags": "+ildct+ilme", "bf": "0"}, "yuv420p"),
    "headers outside": ({"flags": "+global_header", "bf": "0"}, "yuv420p"),
}


@pytest.mark.parametrize("name", STREAMS)
def test_each_frame_that_is_missing_is_noticed(name: str) -> None:
    """Of a whole stream no packet is behind a gap; without one that others need, the next one is."""
    packets, extradata = encoded(*STREAMS[name])
    numbers = FrameNumbers(extradata)
    assert not any(numbers.lacks_reference(data, is_keyframe) for data, is_keyframe in packets)
    for lost in range(1, COUNT - 1):
        numbers = FrameNumbers(extradata)
        gaps = [
            at
            for at, (data, is_keyframe) in enumerate(packets)
            if at != lost and numbers.lacks_reference(data, is_keyframe)
        ]
        is_needed = is_reference(packets[lost][0]) and not packets[lost + 1][1]
        assert gaps[:1] == ([lost + 1] if is_needed else [])


def test_packets_of_a_file_are_understood(small_video: Path) -> None:
    """Packets with lengths instead of start codes, their headers in a box, are followed as well."""
    with av.open(str(small_video)) as container:
        stream = container.streams.video[0]
        extradata = stream.codec_context.extradata or b""
        packets = [(bytes(packet), packet.is_keyframe) for packet in container.demux(stream) if packet.size]
    numbers = FrameNumbers(extradata)
    assert not any(numbers.lacks_reference(data, is_keyframe) for data, is_keyframe in packets)
    numbers = FrameNumbers(extradata)
    assert [numbers.lacks_reference(data, is_keyframe) for data, is_keyframe in (packets[0], packets[2])] == [
        False,
        True,
    ]


@pytest.mark.parametrize(
    "data", [b"", b"\0", b"\0\0\1", b"\0\0\1\x41", b"\0\0\1\x67", b"\0\0\1\x67\x64\0\x1f\xff"]
)
def test_unreadable_units_are_not_a_gap(data: bytes) -> None:
    """The decoder reports units that cannot be parsed."""
    packets, extradata = encoded({"bf": "0"})
    numbers = FrameNumbers(extradata)
    assert not numbers.lacks_reference(*packets[0])
    assert not numbers.lacks_reference(data, is_keyframe=False)
    assert not FrameNumbers(data).lacks_reference(packets[1][0], is_keyframe=False)
    assert not FrameNumbers(b"\1\x64\0\x1f\xff\xff\xff\xff").lacks_reference(data, is_keyframe=False)
