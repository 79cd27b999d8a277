"""livesrc over UDP: senders of several kinds, which fall silent, come back, and send what they should not."""

import random
import re
import socket
import subprocess
import threading
import time
from collections.abc import Callable
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from streamkit import ElementFailure, FrameFlags, MessageKind, Pipeline
from streamkit_media.doctor.examine import examine
from streamkit_telemetry_formats.telemetryreader import TelemetryReader
from tests.waiting import next_state

HOUR = 3600 * 90_000  # ticks of a transport stream
MARGIN_S = 5.0  # for a machine under load
Start = Callable[..., subprocess.Popen[bytes]]
Send = Callable[..., Any]


def no_reader_is_left() -> bool:
    """Whether every thread that reads has ended."""
    return not [thread.name for thread in threading.enumerate() if thread.name.startswith("reader")]


@pytest.mark.parametrize("muxer", ["mpegtsmux alignment=7", "mpegtsmux", "mpegtsmux ! rtpmp2tpay"])
def test_gstreamers_streams_are_received(start_gstreamer: Start, port: int, muxer: str) -> None:
    """MPEG-TS in datagrams, aligned or not, and in RTP: all frames come, with times of arrival."""
    start_gstreamer(muxer, f"udpsink host=127.0.0.1 port={port}")
    with Pipeline.parse(
        f"livesrc name=s uri=udp://127.0.0.1:{port} reconnect=always latency=5000 ! decode ! appsink name=out"
    ) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 60))
        assert (pipeline["s"].lost, pipeline["s"].refused) == (0, 0)
        assert pipeline["s"].is_live
    assert frames[-1].data.shape == (240, 320)
    assert [frame.seq for frame in frames] == list(range(60))
    assert all(a.pts < b.pts for a, b in pairwise(frames))
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames[20:])
    assert {frame.capture.origin for frame in frames} == {"arrival"}
    assert no_reader_is_left()


@pytest.mark.parametrize("count", [1, 2])
def test_a_video_that_is_not_read_is_named(start_gstreamer: Start, port: int, count: int) -> None:
    """A drone's second camera, in the same transport stream, would be missed in silence."""
    second = "videotestsrc is-live=true ! x264enc tune=zerolatency key-int-max=15 ! m. " * (count - 1)
    start_gstreamer("mpegtsmux name=m alignment=7", f"udpsink host=127.0.0.1 port={port} {second}")
    warnings: list[str] = []
    with Pipeline.parse(
        f"livesrc uri=udp://127.0.0.1:{port} reconnect=always ! appsink name=out"
    ) as pipeline:
        pipeline.bus.watch(
            lambda message: message.kind is MessageKind.WARNING and warnings.append(message.text)
        )
        pipeline.play()
        assert len(list(islice(pipeline["out"], 3))) == 3
    assert sum("one video is read, and not [" in text for text in warnings) == count - 1
    checks = examine(f"udp://127.0.0.1:{port}", seconds=1.0, timeout_s=10.0, transport="tcp").checks
    assert [len(check.facts["others"]) for check in checks if check.name == "videos"] == [1] * (count - 1)


def test_a_further_video_is_read_where_it_is_chosen(start_gstreamer: Start, port: int) -> None:
    """The second camera of a transport stream, of another size; no warning then, and an error for none."""
    size = "video/x-raw, width=160, height=120"
    second = f"videotestsrc is-live=true ! {size} ! x264enc tune=zerolatency key-int-max=15 ! m. "
    start_gstreamer("mpegtsmux name=m alignment=7", f"udpsink host=127.0.0.1 port={port} {second}")
    uri = f"livesrc uri=udp://127.0.0.1:{port} reconnect=always"
    sizes, warnings = set(), list[str]()
    for index in (0, 1):
        with Pipeline.parse(f"{uri} video-stream={index} ! decode ! appsink name=out") as pipeline:
            pipeline.bus.watch(
                lambda message: message.kind is MessageKind.WARNING and warnings.append(message.text)
            )
            pipeline.play()
            sizes.add(next(iter(pipeline["out"])).data.shape)
    assert sizes == {(240, 320), (120, 160)}
    assert not [text for text in warnings if "is read" in text]
    with pytest.raises(ElementFailure, match="stream 7 is no video; videos are 0, 1"):
        Pipeline.parse(f"{uri[:-6]}never video-stream=7 ! fakesink").run(timeout_s=20)


def test_telemetry_comes_with_the_video(start_ffmpeg: Start, port: int) -> None:
    """Both KLV streams of FFmpeg's own datagrams, which cut packets in two, have pads and positions."""
    start_ffmpeg(f"udp://127.0.0.1:{port}")
    text = (
        f"livesrc name=s uri=udp://127.0.0.1:{port} reconnect=always  s.src ! fakesink  "
        "s.klv ! appsink name=first  s.klv_1 ! appsink name=second"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        for name, latitude in (("first", 10.0), ("second", 20.0)):
            reader = TelemetryReader()
            packets = list(islice(pipeline[name], 10))
            samples = [
                sample
                for packet in packets
                for sample in reader.packet(packet.data, packet.caps.name, packet.pts)
            ]
            assert {round(sample.latitude, 4) for sample in samples} == {latitude}


def test_a_sender_that_comes_back_is_a_new_epoch(start_ffmpeg: Start, port: int) -> None:
    """Silence is stalled, and the next connection listens at once; times go on, the gap is marked."""
    source = f"livesrc uri=udp://127.0.0.1:{port} reconnect=always timeout-s=1"
    with Pipeline.parse(f"{source} ! decode ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        sender = start_ffmpeg(f"udp://127.0.0.1:{port}")
        frames = iter(pipeline["out"])
        before = list(islice(frames, 20))
        sender.kill()
        sender.wait(10)
        assert "nothing has come for 1 s" in str(next_state(pipeline, "stalled").fields["reason"])
        assert next_state(pipeline, "retrying").fields["delay_s"] == 0
        start_ffmpeg(f"udp://127.0.0.1:{port}")
        after = next(frame for frame in frames if frame.epoch > before[-1].epoch)
    assert after.flags & FrameFlags.DISCONTINUITY
    assert after.pts > before[-1].pts
    assert after.seq > before[-1].seq


@pytest.mark.parametrize("is_rtp", [False, True])
def test_a_sender_that_begins_anew_is_a_new_epoch(
    send: Send, port: int, datagrams: list[bytes], as_rtp: Callable[..., bytes], is_rtp: bool
) -> None:
    """A sender that restarts sooner than silence is noticed does not make times go back.

    Its first keyframe is not lost: the new epoch begins with the same picture as the old one.
    """
    sent = datagrams * 2
    if is_rtp:
        sent = [as_rtp(datagram, number) for number, datagram in enumerate(sent)]
    text = f"livesrc name=s uri=udp://127.0.0.1:{port} timeout-s=20 ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        send(("127.0.0.1", port), sent, 6)
        frames = list(islice(pipeline["out"], 120))
        assert (pipeline["s"].lost, pipeline["s"].overflowed) == (0, 0)
    assert frames[0].epoch == 0
    assert frames[-1].epoch == 1
    first = next(frame for frame in frames if frame.epoch == 1)
    assert np.array_equal(first.data, frames[0].data)
    assert all(a.pts < b.pts for a, b in pairwise(frames))


def test_a_sender_that_has_run_for_an_hour_begins_anew(
    send: Send, port: int, clip: Path, tmp_path: Path, datagrams: list[bytes]
) -> None:
    """FFmpeg takes times that fall by more than a minute for a wrap, so that they seem to rise by a day."""
    later = tmp_path / "later.ts"
    with av.open(str(clip)) as source, av.open(str(later), "w") as output:
        video = source.streams.video[0]
        copy = output.add_stream_from_template(video)
        for packet in source.demux(video):
            if packet.dts is not None and packet.pts is not None:
                packet.pts, packet.dts, packet.stream = packet.pts + HOUR, packet.dts + HOUR, copy
                output.mux(packet)
    data, size = later.read_bytes(), len(datagrams[0])
    before = [data[at : at + size] for at in range(0, len(data), size)]
    text = f"livesrc uri=udp://127.0.0.1:{port} timeout-s=20 ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        send(("127.0.0.1", port), before + datagrams, 6)
        frames = list(islice(pipeline["out"], 120))
    assert (frames[0].epoch, frames[-1].epoch) == (0, 1)
    assert all(a.pts < b.pts for a, b in pairwise(frames))


@pytest.mark.parametrize("way", ["stop", "finish"])
def test_a_silent_port_is_left_at_once(port: int, way: str) -> None:
    """A pipeline that waits for a sender for a minute ends within two seconds."""
    pipeline = Pipeline.parse(f"livesrc uri=udp://@:{port} timeout-s=60 ! decode ! fakesink")
    with pipeline:
        pipeline.play()
        next_state(pipeline, "connecting")
        began = time.monotonic()
        if way == "finish":
            pipeline.finish()
            message = pipeline.wait(MARGIN_S)
            assert message is not None
            assert message.kind is MessageKind.EOS
    assert time.monotonic() - began < 2 + MARGIN_S
    assert no_reader_is_left()


def test_a_port_without_a_sender_is_reported(port: int) -> None:
    """A first connection that nothing comes to ends the pipeline, with what to check."""
    with pytest.raises(
        ElementFailure, match=r"no video within 0\.3 s \(timeout-s\): nothing has come to this port"
    ):
        Pipeline.parse(f"livesrc uri=udp://@:{port} timeout-s=0.3 ! fakesink").run(timeout_s=20)


@pytest.mark.parametrize("is_foreign", [False, True])
def test_a_wait_is_reported(monkeypatch: pytest.MonkeyPatch, port: int, is_foreign: bool) -> None:
    """Long before the time limit, once: where, what for, and whether anything has come."""
    monkeypatch.setattr("streamkit_media.live.datagraminput.NOTICE_S", 0.5)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
        Pipeline.parse(f"livesrc uri=udp://127.0.0.1:{port} timeout-s=60 ! fakesink") as pipeline,
    ):
        pipeline.play()
        message, deadline = None, time.monotonic() + 20
        while message is None and time.monotonic() < deadline:
            if is_foreign:
                sender.sendto(b"\x80\x60" + bytes(40), ("127.0.0.1", port))  # RTP, as of rtph264pay
            message = pipeline.bus.pop(0.1, (MessageKind.WARNING,))
        assert message is not None
        what = (
            r"\d+ datagrams have come to this port, none of them MPEG-TS"
            if is_foreign
            else ("nothing has come to this port")
        )
        wait = r"yet; waiting up to 60 s \(timeout-s\)"
        assert re.search(rf"udp://127\.0\.0\.1:{port}: {what} {wait}", message.text)
        assert pipeline.bus.pop(0.7, (MessageKind.WARNING,)) is None


def test_a_port_in_use_is_reported(port: int) -> None:
    """Two receivers of one port would take each other's datagrams."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", port))
        with pytest.raises(ElementFailure, match="another program receives there"):
            Pipeline.parse(f"livesrc uri=udp://127.0.0.1:{port} ! fakesink").run(timeout_s=20)


@pytest.mark.parametrize(
    ("uri", "host"),
    [
        ("udp://239.7.7.7:{port}?localaddr=127.0.0.1", "239.7.7.7"),
        ("udp://@239.7.7.7:{port}?localaddr=127.0.0.1", "239.7.7.7"),
        ("udp://[::1]:{port}", "::1"),
        ("udp://:{port}", "127.0.0.1"),
        ("udp://localhost:{port}", "127.0.0.1"),
    ],
)
def test_groups_and_ipv6(send: Send, port: int, datagrams: list[bytes], uri: str, host: str) -> None:
    """Groups, with or without @, IPv6, every interface, and names."""
    with Pipeline.parse(f"livesrc uri={uri.format(port=port)} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        send((host, port), datagrams * 4, 12)
        assert len(list(islice(pipeline["out"], 20))) == 20


def test_gaps_in_rtp_are_counted(
    send: Send, port: int, datagrams: list[bytes], as_rtp: Callable[..., bytes]
) -> None:
    """Packets missing, repeated and late are counted, and those missing warned of at the end.

    The frames around a gap are marked as damaged.
    """
    packets = [as_rtp(data, 65530 + number) for number, data in enumerate(datagrams)]
    middle = len(packets) // 2
    packets[middle : middle + 3] = [packets[middle - 1]]
    with Pipeline.parse(
        f"livesrc name=s uri=udp://127.0.0.1:{port} latency=5000 ! decode ! appsink name=out max-buffers=0"
    ) as pipeline:
        warnings: list[str] = []
        pipeline.bus.watch(
            lambda message: message.kind is MessageKind.WARNING and warnings.append(message.text)
        )
        pipeline.play()
        sender = send(("127.0.0.1", port), packets, 4)
        frames = list(islice(pipeline["out"], 70))
        sender.wait()
        assert (pipeline["s"].lost, pipeline["s"].refused) == (3, 1)
    damaged = [frame.seq for frame in frames if frame.flags & FrameFlags.CORRUPT]
    assert damaged
    assert min(damaged) > 30
    assert any(text.endswith(": 3 datagrams were lost on their way here") for text in warnings)


@pytest.mark.parametrize("seed", range(4))
def test_hostile_bytes_do_no_harm(send: Send, port: int, datagrams: list[bytes], seed: int) -> None:
    """Random datagrams beside the stream are refused, the stream goes on."""
    generator = random.Random(seed)
    mixed = []
    for datagram in datagrams:
        junk = generator.randbytes(generator.choice([0, 1, 11, 12, 187, 188, 1316, 9000, 60_000]))
        header = generator.choice([b"", b"", b"\x80\x21", b"\xbf\x21", b"\x90\xa1"])
        mixed += [datagram, (header + junk).replace(b"\x47", b"\x48")]
    text = f"livesrc name=s uri=udp://127.0.0.1:{port} latency=5000 ! decode ! appsink name=out max-buffers=0"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        send(("127.0.0.1", port), mixed, 4)
        frames = list(islice(pipeline["out"], 80))
        assert pipeline["s"].refused > 20
        assert pipeline["s"].lost == 0
    assert {frame.epoch for frame in frames} == {0}


@pytest.mark.parametrize("seed", range(4))
def test_hostile_transport_packets_never_crash(
    send: Send, port: int, datagrams: list[bytes], seed: int
) -> None:
    """Transport packets of random content, alone and amid the stream, end in frames or an error in time."""
    generator = random.Random(seed)
    mixed = []
    for datagram in datagrams:
        packets = [b"\x47" + generator.randbytes(187) for _ in range(7)]
        damaged = bytearray(datagram)
        for _ in range(5):
            damaged[generator.randrange(len(damaged))] = generator.randrange(256)
        mixed += generator.choices([datagram, b"".join(packets), bytes(damaged)], [8, 1, 1], k=1)
    source = f"livesrc uri=udp://127.0.0.1:{port} reconnect=always timeout-s=1"
    with Pipeline.parse(f"{source} ! fakesink") as pipeline:
        pipeline.play()
        send(("127.0.0.1", port), mixed, 2).wait()
        next_state(pipeline, "stalled")
    assert no_reader_is_left()


REFUSED = {
    "srt://drone": "the port is missing; write srt://HOST:PORT",
    "srt://:9000": "the host is missing; write srt://HOST:PORT, or srt://:PORT?mode=listener",
    "v4l2:///dev/video0?size=9": "a camera has video_size, framerate, input_format, got size",
    "v4l2://drone/video0": "must begin with udp:// or tcp://",
    "rtsp://drone/live": "write rtspsrc location=",
    "rtp://@:5000": "write uri=udp://@:PORT",
    "flight.mp4": "write filesrc location=FILE",
    "file:///flight.mp4": "write filesrc location=FILE",
    "": "must begin with udp:// or tcp://",
    "10.0.0.7:554/live": "an address must begin with its protocol; write uri=http://",
    "udp://239.1.1.1": "the port is missing",
    "udp://239.1.1.1:x": "the port must be a number",
    "udp://@:5000?fifo_size=9": "it takes ?localaddr=ADDRESS only, not fifo_size",
    "tcp://drone": "the port is missing",
    "gopher://drone": "must begin with udp:// or tcp://",
}


@pytest.mark.parametrize("uri", REFUSED)
def test_other_addresses_are_refused_with_a_remedy(uri: str) -> None:
    """What is received by another element, or by a bridge, says so before playing."""
    pipeline = Pipeline.parse(f'livesrc uri="{uri}" ! fakesink')
    with pytest.raises(ElementFailure) as caught:
        pipeline.ready()
    pipeline.stop()
    assert REFUSED[uri] in str(caught.value)


def test_a_uri_alone_makes_the_element() -> None:
    """udp://... ! decode is livesrc uri=udp://... ! decode."""
    element = next(iter(Pipeline.parse("udp://@:5000 ! fakesink").graph.elements))
    assert (element.factory, element.location) == ("livesrc", "udp://@:5000")


def test_the_sample_of_telemetry_plays(send: Send, port: int, streamkit_data: Path) -> None:
    """A recording of STANAG 4609 has its KLV over UDP too."""
    data = (streamkit_data / "telemetry" / "sample-stream.ts").read_bytes()
    cut = [data[at : at + 1316] for at in range(0, len(data) // 3, 1316)]
    text = f"livesrc name=s uri=udp://127.0.0.1:{port}  s.src ! fakesink  s.klv ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        send(("127.0.0.1", port), cut, 3)
        reader = TelemetryReader()
        frame = next(iter(pipeline["out"]))
        reader.packet(frame.data, frame.caps.name, frame.pts)
        reader.finish()
    assert reader.counts()["good_packets"] == 1
