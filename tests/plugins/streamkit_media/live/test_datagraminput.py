"""Frames out of a transport stream without FFmpeg's parser."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from streamkit_media.container import open_container, video_stream
from streamkit_media.live.accessunits import UNPARSED, whole_frames
from streamkit_media.live.liveinput import LIVE_OPTIONS
from streamkit_media.streams import read_packets

STREAMS = ("klv_ts/h264_klv.ts", "klv_ts/h265_klv.ts", "sample-stream.ts")


class Bytes:
    """A stream that FFmpeg reads datagram by datagram."""

    def __init__(self, data: bytes) -> None:
        self.data, self.position = data, 0

    def read(self, size: int) -> bytes:
        """The next datagram."""
        found = self.data[self.position : self.position + min(size, 1316)]
        self.position += len(found)
        return found


def parsed(source: Bytes) -> Iterator[Any]:
    """The video's packets by FFmpeg's parser."""
    with open_container("udp://@:1", LIVE_OPTIONS, format_name="mpegts", stream=source) as container:
        yield from read_packets(container, video_stream(container, ""))


def unparsed(source: Bytes) -> Iterator[Any]:
    """The video's packets without it."""
    options = {**LIVE_OPTIONS, **UNPARSED}
    with open_container("udp://@:1", options, format_name="mpegts", stream=source) as container:
        video = video_stream(container, "")
        yield from whole_frames(container, read_packets(container, video), video)


@pytest.mark.parametrize("name", STREAMS)
def test_frames_are_those_of_the_parser(streamkit_data: Path, name: str) -> None:
    """Times, keyframes and bytes are the same."""
    data = (streamkit_data / "telemetry" / name).read_bytes()
    expected, found = (
        [(packet.pts, packet.dts, packet.is_keyframe, bytes(packet)) for packet in read(Bytes(data))]
        for read in (parsed, unparsed)
    )
    assert found == expected


def test_a_codec_unknown_here_has_key_frames_too(streamkit_data: Path) -> None:
    """FFmpeg's parser takes over after what it has read to detect the stream."""
    data = (streamkit_data / "telemetry" / "klv_ts" / "mpeg2_klv.ts").read_bytes()
    expected, found = (list(read(Bytes(data * 3))) for read in (parsed, unparsed))
    assert len(found) == pytest.approx(len(expected), abs=2)
    assert any(packet.is_keyframe for packet in found)


def test_a_frame_is_complete_when_the_next_begins(clip: Path) -> None:
    """No more of the stream is read than its next datagram or two: the parser needs another frame."""
    with av.open(str(clip)) as container:
        starts = [packet.pos for packet in container.demux(video=0) if packet.pos is not None]
    source = Bytes(clip.read_bytes())
    behind = [
        source.position - starts[index + 1] for index, _ in enumerate(unparsed(source)) if 80 < index < 95
    ]
    assert max(behind) <= 3 * 1316


def test_several_frames_in_one_packet_are_parsed(clip: Path, tmp_path: Path) -> None:
    """Where a muxer joins frames, the parser takes over, and every later frame is a packet of its own."""
    path = tmp_path / "joined.ts"
    with av.open(str(clip)) as source, av.open(str(path), "w", format="mpegts") as output:
        video = source.streams.video[0]
        copy = output.add_stream_from_template(video)
        packets = [packet for packet in source.demux(video) if packet.dts is not None]
        for first, second in zip(packets[::2], packets[1::2], strict=True):
            joined = av.Packet(bytes(first) + bytes(second))
            joined.pts, joined.dts, joined.time_base = first.pts, first.dts, Fraction(1, 90_000)
            joined.is_keyframe, joined.stream = first.is_keyframe, copy
            output.mux(joined)
    data = path.read_bytes()
    frames = list(unparsed(Bytes(data)))
    assert len(list(parsed(Bytes(data)))) == 100
    assert len(frames) > 60


def test_a_frame_of_several_pieces_is_joined(tmp_path: Path) -> None:
    """FFmpeg hands on a PES packet of more than 200 KB in pieces; the frame is whole again, and key."""
    path = tmp_path / "large.ts"
    noise = np.random.default_rng(1).integers(0, 256, (540, 640), np.uint8)
    with av.open(str(path), "w", format="mpegts") as output:
        stream = output.add_stream("libx264", rate=25, options={"crf": "4", "preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt, stream.gop_size = 640, 360, "yuv420p", 2
        for number in range(6):
            frame = av.VideoFrame.from_ndarray(np.roll(noise, number), "yuv420p")
            frame.pts = number
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))
    expected, found = (list(read(Bytes(path.read_bytes()))) for read in (parsed, unparsed))
    assert max(packet.size for packet in expected) > 200_000
    assert [bytes(packet) for packet in found] == [bytes(packet) for packet in expected]
    assert [packet.is_keyframe for packet in found] == [packet.is_keyframe for packet in expected]
