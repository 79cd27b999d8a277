import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from av.codec.context import ThreadType
from av.error import FFmpegError

from streamkit_media.codecs import video_caps
from streamkit_media.container import open_container, video_stream
from streamkit_media.decoding.videodecoder import VideoDecoder
from streamkit_media.streams import read_packets

MakeVideo = Callable[..., Path]


@pytest.mark.parametrize("threading", [ThreadType.FRAME, ThreadType.SLICE])
@pytest.mark.parametrize("as_bytes", [False, True])
def test_each_frame_knows_its_packet(small_video: Path, threading: ThreadType, as_bytes: bool) -> None:
    """With B-frames and threads every frame comes out once, in order, with its own packet's origin."""
    with open_container(str(small_video)) as container:
        stream = video_stream(container, "small")
        decoder: VideoDecoder[int | None] = VideoDecoder(video_caps(stream), threading, threads=2)
        decoded = []
        for packet in read_packets(container, stream):
            decoded += decoder.decode(bytes(packet) if as_bytes else packet, packet.pts)
        decoded += decoder.drain()
    origins = [origin for _, origin in decoded]
    assert len(origins) == 12
    assert origins == sorted(set(origins), key=lambda pts: pts or 0)
    for index, (video_frame, _) in enumerate(decoded):
        corner = video_frame.to_ndarray()[:8, :8].astype(int)
        rows, columns = np.mgrid[:8, :8]
        assert np.abs(corner - (40 + (rows + columns + 4 * index) % 160)).mean() < 4


def test_a_packet_is_not_changed(small_video: Path) -> None:
    """The packet given may be shared with other threads: nothing in it changes."""
    with open_container(str(small_video)) as container:
        stream = video_stream(container, "small")
        packet = next(read_packets(container, stream))
        before = (packet.pts, packet.dts, packet.time_base, bytes(packet))
        VideoDecoder[None](video_caps(stream)).decode(packet, None)
    assert (packet.pts, packet.dts, packet.time_base, bytes(packet)) == before


def test_damage_is_an_error_and_the_next_packet_decodes(small_video: Path) -> None:
    """The decoder continues after a packet of random bytes."""
    with open_container(str(small_video)) as container:
        stream = video_stream(container, "small")
        decoder: VideoDecoder[int] = VideoDecoder(video_caps(stream), ThreadType.SLICE)
        packets = list(read_packets(container, stream))
    with pytest.raises(FFmpegError):
        decoder.decode(b"\xff" * 100, -1)
    decoded = [pair for number, packet in enumerate(packets) for pair in decoder.decode(packet, number)]
    assert len(decoded + decoder.drain()) == 12


def test_draining_an_unused_decoder_gives_nothing(small_video: Path) -> None:
    """A decoder that got nothing holds nothing."""
    with open_container(str(small_video)) as container:
        decoder = VideoDecoder[int](video_caps(video_stream(container, "small")))
    assert decoder.drain() == []


@pytest.mark.parametrize("threading", [ThreadType.FRAME, ThreadType.SLICE])
def test_h265_never_gets_frame_threads(make_video: MakeVideo, threading: ThreadType) -> None:
    """FFmpeg's frame threads of H.265 wait for ever on some damaged streams whose damage is to be shown."""
    with open_container(str(make_video("threads.mkv", codec="libx265"))) as container:
        decoder = VideoDecoder[int](video_caps(video_stream(container, "threads")), threading)
    assert decoder.threading is ThreadType.SLICE


@pytest.mark.parametrize("place", [-1, -3, -5])
@pytest.mark.parametrize("bframes", [0, 3])
def test_a_damaged_packet_among_the_last_costs_no_other_frame(
    make_video: MakeVideo, place: int, bframes: int
) -> None:
    """Frame threads hold the last frames; the error of one of them takes none of the others along."""
    path = make_video(f"damaged_end_{bframes}.mkv", count=30, bframes=bframes, options={"g": "30"})
    with open_container(str(path)) as container:
        stream = video_stream(container, "damaged end")
        decoder = VideoDecoder[int](video_caps(stream), ThreadType.FRAME, 6)
        packets = [bytes(packet) for packet in read_packets(container, stream)]
    packets[place] = packets[place][:5] + b"\xff" * (len(packets[place]) - 5)
    frames = [origin for number, data in enumerate(packets) for _, origin in decoder.decode(data, number)]
    frames += [origin for _, origin in decoder.drain()]
    assert sorted(frames) == sorted(set(range(30)) - {30 + place})
    assert len(decoder.drain_errors) == 1
    assert decoder.unaccounted == 0


DECODE_MUTANTS = """
import random, sys
from av.codec.context import ThreadType
from av.error import FFmpegError
from streamkit_media.codecs import video_caps
from streamkit_media.container import open_container, video_stream
from streamkit_media.streams import read_packets
from streamkit_media.decoding.videodecoder import VideoDecoder

def attempt(call, *arguments):
    try:
        return len(call(*arguments))
    except FFmpegError:
        return 0

with open_container(sys.argv[1]) as container:
    stream = video_stream(container, "mutant")
    caps, packets = video_caps(stream), [bytes(p) for p in read_packets(container, stream)]
shown = 0
for seed in range(400):
    chance = random.Random(seed)
    decoder = VideoDecoder(caps, ThreadType.FRAME, threads=4)
    for number, packet in enumerate(packets):
        data = bytearray(packet)
        for _ in range(chance.choice((0, 0, 1, 8))):
            data[chance.randrange(min(chance.choice((40, len(data))), len(data)))] = chance.randrange(256)
        del data[chance.choice((len(data), len(data), chance.randrange(len(data)) + 1)):]
        shown += attempt(decoder.decode, bytes(data), number)
    shown += attempt(decoder.drain)
print(shown)
"""


@pytest.mark.parametrize("codec", ["libx264", "libx265", "mpeg4"])
def test_damaged_streams_end(make_video: MakeVideo, codec: str) -> None:
    """Four hundred damaged streams decode without a hang, frame threads asked for, and give frames."""
    path = make_video(f"mutants_{codec}.mkv", codec=codec, count=16, size=(160, 96))
    done = subprocess.run(
        [sys.executable, "-c", DECODE_MUTANTS, str(path)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 1000
