"""With low-latency a frame arrives with its last packet; without it, with the next frame."""

from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np
import pytest

from streamkit import FrameFlags, Pipeline
from streamkit_media.rtsp import rtspinput

StartServer = Callable[..., Any]
NO_MORE = "send ten frames and half of another, then nothing"


def test_the_last_frame_sent_is_received(start_server: StartServer) -> None:
    """Of a server that falls silent after ten frames all ten arrive, though no other follows."""
    server = start_server(NO_MORE)
    with Pipeline.parse(f"rtspsrc location={server.url} timeout-s=30 ! appsink name=out") as pipeline:
        pipeline.play()
        packets = list(islice(pipeline["out"], 10))
    assert [packet.seq for packet in packets] == list(range(10))
    assert packets[0].flags & FrameFlags.KEYFRAME


@pytest.mark.parametrize("loses_every", [0, 7])
def test_frames_are_never_mixed_when_packets_are_lost(
    start_server: StartServer, fake: Any, loses_every: int
) -> None:
    """A packet has the bytes of one frame; where RTP packets are missing, no two frames are mixed."""
    units = fake.access_units((320, 240), count=60)
    server = start_server(units=units, loses_every=loses_every)
    with Pipeline.parse(f"rtspsrc location={server.url} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        packets = list(islice(pipeline["out"], 40))
    known = [fake.nal_units(unit) for unit in units]
    for packet in packets:
        found = fake.nal_units(bytes(packet.data))
        assert sum(nal[0] & 31 in (1, 5) and nal[1] >= 0x80 for nal in found) <= 1
        assert loses_every or found in known


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_parameter_sets_before_each_slice_damage_no_frame(
    start_server: StartServer, fake: Any, transport: str
) -> None:
    """As of GStreamer's rtph264pay config-interval=-1: a parser would end a frame at each."""
    units = []
    for unit in fake.access_units((320, 240), slices="2", threads="1"):
        nals = fake.nal_units(unit)
        sets = [nal for nal in nals if nal[0] & 31 in (7, 8)]
        slices = [nal for nal in nals if nal[0] & 31 in (1, 5)]
        assert len(slices) == 2
        units.append(b"".join(b"\0\0\0\1" + nal for part in slices for nal in (*sets, part)))
    server = start_server(units=units)
    source = f"rtspsrc location={server.url} transport={transport} latency=5000"
    with Pipeline.parse(f"{source} ! decode ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 40))
    assert [round(float(frame.data.mean()) / 2) for frame in frames] == [20 + n for n in range(40)]
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)


def test_streams_without_parameter_sets_in_advance_play(start_server: StartServer, fake: Any) -> None:
    """H.265 whose parameter sets come with the frames only plays by FFmpeg's own parser."""
    server = start_server(units=fake.access_units(codec="libx265"), codec="h265")
    with Pipeline.parse(f"rtspsrc location={server.url} ! decode ! appsink name=out") as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 5))
    assert {frame.data.shape for frame in frames} == {(48, 64)}


def test_without_low_latency_ffmpeg_parses(
    start_server: StartServer, fake: Any, units: list[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With low-latency=false nothing peeks at the socket; packets, their times and frames are the same."""
    calls = []
    with_marks = rtspinput.with_marks

    def counted(*arguments: Any) -> Any:
        calls.append(arguments)
        return with_marks(*arguments)

    monkeypatch.setattr(rtspinput, "with_marks", counted)
    found = {}
    for switch in ("true", "false"):
        server = start_server(units=units)
        source = f"rtspsrc location={server.url} latency=5000 low-latency={switch}"
        with Pipeline.parse(
            f"{source} ! tee name=t  t. ! appsink name=packets max-buffers=0  "
            "t. ! decode ! appsink name=frames max-buffers=0"
        ) as pipeline:
            pipeline.play()
            packets = list(islice(pipeline["packets"], 25))
            frames = list(islice(pipeline["frames"], 20))
        found[switch] = packets, frames
        assert bool(calls) is (switch == "true")
        calls.clear()
    for packets, frames in found.values():
        nals = [fake.nal_units(bytes(packet.data)) for packet in packets]
        assert nals == [fake.nal_units(unit) for unit in units[:25]]
        assert [bool(packet.flags & FrameFlags.KEYFRAME) for packet in packets] == [
            n % 15 == 0 for n in range(25)
        ]
        assert [round(float(frame.data.mean()) / 2) for frame in frames] == [20 + n for n in range(20)]
    (fast, _), (parsed, _) = found["true"], found["false"]
    steps = [np.diff([packet.pts for packet in packets]) for packets in (fast, parsed)]
    np.testing.assert_allclose(steps[0], steps[1], atol=20_000)
