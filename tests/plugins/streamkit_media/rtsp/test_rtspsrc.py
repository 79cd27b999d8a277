import re
import signal
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import islice, pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import av
import pytest

from streamkit import ElementFailure, FrameFlags, MessageKind, Pipeline

MARGIN_S = 5.0  # for a machine under load; benchmarks/rtsp_faults.py measures how soon faults are noticed
Serve = Callable[[int], int]


def fails(text: str) -> tuple[str, float]:
    """The error a pipeline ends in, and after how many seconds."""
    began = time.monotonic()
    with pytest.raises(ElementFailure) as caught:
        Pipeline.parse(f"{text} ! decode ! fakesink").run(timeout_s=20)
    return str(caught.value), time.monotonic() - began


@pytest.mark.parametrize("answers", [0, 1])
@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_silent_server_is_noticed(serve: Serve, answers: int, transport: str) -> None:
    """Silence ends in one error within timeout-s + 1 s; no password, no thread stays."""
    location = f"rtsp://me:secret@127.0.0.1:{serve(answers)}/live"
    error, elapsed = fails(f"rtspsrc location={location} timeout-s=0.5 transport={transport}")
    assert "no video within 0.5 s" in error
    assert "secret" not in error
    assert elapsed < 0.5 + MARGIN_S
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("reader")]


def test_another_transport_is_advised_only_where_it_was_not_tried(serve: Serve) -> None:
    """A silent server gets the advice of TCP after UDP alone; not where `auto` has tried both."""
    advice = "if it does over TCP, set transport=tcp or transport=auto"
    for transport, is_advised in (("udp", True), ("auto", False)):
        location = f"rtsp://127.0.0.1:{serve(0)}/live"
        error, _ = fails(f"rtspsrc location={location} timeout-s=0.5 transport={transport}")
        assert (advice in error) is is_advised


def test_a_server_without_tcp_gets_the_advice_of_udp(fake: ModuleType) -> None:
    """TCP is the default, so that its user may not know of the other; with the advice the video plays."""
    advice = (
        "does not send over the transport asked for; if it does over UDP, set transport=udp or transport=auto"
    )
    with fake.FakeServer(fake.access_units(), behaviour=fake.Behaviour.NO_TCP) as server:
        error, _ = fails(f"rtspsrc location={server.url}")
        assert advice in error
        text = f"rtspsrc location={server.url} transport=auto ! decode ! appsink name=out"
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            assert next(iter(pipeline["out"])).epoch == 0


def test_a_closed_port_is_reported() -> None:
    """A refused connection gives its reason at once."""
    error, elapsed = fails("rtspsrc location=rtsp://me:secret@127.0.0.1:1/live")
    assert error == (
        "rtspsrc0: rtsp://***@127.0.0.1:1/live: no connection to 127.0.0.1 port 1: Connection refused; "
        "check the address"
    )
    assert elapsed < MARGIN_S


@pytest.mark.parametrize("links", ["s.video ! {a}", "s.src ! {a}", "s.src ! {a}  s.video ! {b}", "s. ! {a}"])
def test_the_video_has_the_pads_of_a_file(fake: ModuleType, links: str) -> None:
    """`src` and `video` carry the same packets, each where it is linked."""
    text = links.format(a="appsink name=a max-buffers=0", b="appsink name=b max-buffers=0")
    with (
        fake.FakeServer(fake.access_units()) as server,
        Pipeline.parse(f"rtspsrc name=s location={server.url}  {text}") as pipeline,
    ):
        pipeline.play()
        numbers = [
            [frame.seq for frame in islice(pipeline[name], 20)] for name in "ab"[: text.count("appsink")]
        ]
    assert all(found == list(range(20)) for found in numbers)


@pytest.mark.parametrize(
    "location",
    ["", "cam/live", "u:secret@cam/live", "http://u:secret@cam/live", "rtsp://", "rtsp://cam:port/x"],
)
def test_other_locations_fail_before_playing(location: str) -> None:
    """A location that is not an RTSP URL is refused when the element starts, with an example."""
    pipeline = Pipeline.parse(f'rtspsrc location="{location}" ! decode ! fakesink')
    with pytest.raises(ElementFailure, match=r"write (location=)?rtsp://host:port/path") as caught:
        pipeline.ready()
    pipeline.stop()
    assert "secret" not in str(caught.value)


@pytest.mark.parametrize("transport", ["tcp", "udp"])
@pytest.mark.parametrize("after_s", [0.0, 0.2])
def test_stopping_while_connecting_is_quick(serve: Serve, transport: str, after_s: float) -> None:
    """A pipeline that waits on a silent server for a minute stops within two seconds."""
    source = f"rtspsrc location=rtsp://127.0.0.1:{serve(1)}/x timeout-s=60 transport={transport}"
    pipeline = Pipeline.parse(f"{source} ! decode ! fakesink")
    pipeline.play()
    assert pipeline.wait(after_s) is None
    began = time.monotonic()
    pipeline.stop()
    assert time.monotonic() - began < MARGIN_S
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("reader")]


def test_the_location_is_shown_without_password() -> None:
    """A graph's settings hold the address, not the password."""
    element = Pipeline.parse("rtspsrc name=r location=rtsp://me:secret@cam/live ! decode ! fakesink")["r"]
    assert element.properties_set()["location"] == "rtsp://***@cam/live"


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_real_server_plays(real_server: Any, transport: str) -> None:
    """Live frames come with arrival and capture time, all of them in order, the first one whole."""
    scheme = "rtsp" if transport == "tcp" else "RTSP"
    location = f"{scheme}://user:secret@127.0.0.1:{real_server.port}/live"
    source = f"rtspsrc name=r location={location} transport={transport} latency=4000"
    text = f"{source} ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        assert pipeline["r"].is_live
        pipeline.play()
        frames, ages = [], []
        for frame in islice(pipeline["out"], 40):
            frames.append(frame)
            ages.append(time.monotonic_ns() - frame.arrival_ns)
    assert frames[0].data.shape == (240, 320)
    assert frames[0].flags == FrameFlags.KEYFRAME
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)
    assert [frame.seq for frame in frames] == list(range(40))
    assert all(a.pts < b.pts for a, b in pairwise(frames))
    assert {frame.capture.origin for frame in frames} <= {"arrival", "rtcp"}
    assert sorted(ages)[20] < 1e9


@pytest.mark.parametrize(
    ("user", "path", "reason"), [("user:wrong", "live", "401"), ("user:secret", "nosuch", "404")]
)
def test_a_real_servers_refusal_is_reported(real_server: Any, user: str, path: str, reason: str) -> None:
    """A wrong password and a wrong path give different errors, without the password."""
    error, elapsed = fails(f"rtspsrc location=rtsp://{user}@127.0.0.1:{real_server.port}/{path}")
    assert reason in error
    assert user.partition(":")[2] not in error
    assert elapsed < MARGIN_S


def test_vp9_can_be_recorded(real_server: Any, tmp_path: Path) -> None:
    """FFmpeg marks none of its keyframes, with which a recording begins."""
    location = f"rtsp://user:secret@127.0.0.1:{real_server.port}/vp9"
    text = f"rtspsrc location={location} ! identity eos-after=40 ! packetsink location={tmp_path}/vp9.mkv"
    Pipeline.parse(text).run(timeout_s=60)
    with av.open(str(tmp_path / "vp9.mkv")) as container:
        keyframes = [packet.is_keyframe for packet in container.demux(video=0) if packet.size]
    assert sum(keyframes) >= 2
    assert len(keyframes) > 20


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_jpeg_is_received(real_server: Any, transport: str) -> None:
    """As many cameras send it (RFC 2435)."""
    location = f"rtsp://user:secret@127.0.0.1:{real_server.port}/jpeg"
    text = f"rtspsrc location={location} transport={transport} ! decode ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 5))
    assert [frame.data.shape for frame in frames] == [(240, 320)] * 5


def test_jpeg_too_large_for_rtp_is_named(real_server: Any) -> None:
    """Its size is missing in the packets: no decoder can read them, and no retry helps."""
    location = f"rtsp://user:secret@127.0.0.1:{real_server.port}/large-jpeg"
    pipeline = Pipeline.parse(f"rtspsrc location={location} transport=tcp ! decode ! fakesink")
    rule = r"rtsp://\*\*\*@.*: its JPEG pictures are wider or higher than 2040 pixels.*; set the camera to "
    with pytest.raises(ElementFailure, match=rule):
        pipeline.run(timeout_s=30)


@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_server_that_freezes_is_noticed(real_server: Any, transport: str) -> None:
    """A server stopped amid the stream ends in an error within timeout-s + 1 s."""
    location = f"rtsp://user:secret@127.0.0.1:{real_server.port}/live"
    source = f"rtspsrc location={location} transport={transport} timeout-s=1 reconnect=never"
    text = f"{source} ! decode ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        assert len(list(islice(frames, 15))) == 15
        real_server.process.send_signal(signal.SIGSTOP)
        began = time.monotonic()
        with suppress(ElementFailure):
            list(frames)
        assert time.monotonic() - began < 1 + MARGIN_S
        message = pipeline.wait(5)
    assert message is not None
    assert re.search(r"rtsp://\*\*\*@.* the server has been silent for 1 s", message.text)


def test_a_server_that_dies_ends_the_stream(real_server: Any) -> None:
    """A server killed amid the stream ends it with a warning, all frames before delivered."""
    location = f"rtsp://user:secret@127.0.0.1:{real_server.port}/live"
    with Pipeline.parse(
        f"rtspsrc location={location} reconnect=never ! decode ! appsink name=out"
    ) as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        assert len(list(islice(frames, 15))) == 15
        real_server.close()
        assert len(list(frames)) < 15
        texts = []
        while (warning := pipeline.bus.pop(1, (MessageKind.WARNING,))) is not None:
            texts.append(warning.text)
    assert any("the server has ended the stream" in text for text in texts)


def test_a_slow_consumer_gets_the_newest(real_server: Any) -> None:
    """Packets that are not taken are dropped and counted; after each gap the delivered ones decode."""
    location = f"rtsp://user:secret@127.0.0.1:{real_server.port}/live"
    text = f"rtspsrc name=r location={location} max-packets=16 ! appsink name=out max-buffers=1"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        taken = []
        for _ in range(12):
            taken.append(pipeline["out"].pull(5))
            pipeline.ended.wait(0.15)
        dropped = sum(pipeline["r"].drops.values())
    gaps = [b for a, b in pairwise(taken) if b.seq > a.seq + 1]
    assert gaps
    assert all(frame.flags & FrameFlags.KEYFRAME and frame.flags & FrameFlags.DISCONTINUITY for frame in gaps)
    assert sum(b.seq - a.seq - 1 for a, b in pairwise(taken)) <= dropped


@pytest.mark.parametrize("transport", ["tcp", "udp"])
@pytest.mark.parametrize("low_latency", [True, False])
def test_a_server_whose_time_stands_still(fake: ModuleType, transport: str, low_latency: bool) -> None:
    """Every frame comes out by itself; after some of one time theirs is that of arrival, with a warning."""
    with fake.FakeServer(fake.access_units((320, 240)), stands_still=True) as server:
        source = f"rtspsrc location={server.url} transport={transport} low-latency={low_latency}"
        with Pipeline.parse(f"{source} ! decode ! appsink name=out max-buffers=0") as pipeline:
            pipeline.play()
            frames = list(islice(pipeline["out"], 40))
            warning = pipeline.bus.pop(5, (MessageKind.WARNING,))
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)
    times = [frame.pts for frame in frames]
    assert times[:10] == [times[0]] * 10
    assert times[12:] == sorted(set(times[12:]))
    assert warning is not None
    assert "the server gives all frames one time" in warning.text
