"""A live picture is there with its last packet, not with the next picture."""

from collections.abc import Callable
from itertools import islice
from typing import Any

import pytest

from streamkit import FrameFlags, Pipeline

StartServer = Callable[..., Any]
NO_MORE = "send ten frames and half of another, then nothing"


def test_the_last_picture_sent_is_received(start_server: StartServer) -> None:
    """Of a server that falls silent after ten pictures all ten come, though no other follows."""
    server = start_server(NO_MORE)
    with Pipeline.parse(f"rtspsrc location={server.url} timeout-s=30 ! appsink name=out") as pipeline:
        pipeline.play()
        packets = list(islice(pipeline["out"], 10))
    assert [packet.seq for packet in packets] == list(range(10))
    assert packets[0].flags & FrameFlags.KEYFRAME


@pytest.mark.parametrize("loses_every", [0, 7])
def test_pictures_are_whole_whatever_is_lost(start_server: StartServer, fake: Any, loses_every: int) -> None:
    """The packets' bytes are the pictures'; where RTP packets are missing, no two pictures are mixed."""
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


def test_streams_without_parameter_sets_in_advance_play(start_server: StartServer, fake: Any) -> None:
    """H.265 whose parameter sets come with the pictures alone plays by FFmpeg's own parser."""
    server = start_server(units=fake.access_units(codec="libx265"), codec="h265")
    with Pipeline.parse(f"rtspsrc location={server.url} ! decode ! appsink name=out") as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 5))
    assert {frame.data.shape for frame in frames} == {(48, 64)}
