import os
import re
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import av
import pytest

from streamkit import Caps, ElementFailure, Frame, FrameFlags, MessageKind, Pipeline
from streamkit.testing import Harness

SYSTEM_PYTHON = "/usr/bin/python3"
RTSP_SERVER = Path(__file__).with_name("gst_server.py")
HAS_RTSP_SERVER = """
import gi
gi.require_version("GstRtspServer", "1.0")
from gi.repository import Gst, GstRtspServer
Gst.init(None)
assert Gst.ElementFactory.find("rtph264depay")
"""
PICTURES = "videotestsrc num-buffers=1000 ! video/x-raw, width=320, height=240 ! encode gop=10 live=true"
NOT_PACED = f"{PICTURES} ! rtspclientsink name=out"
MARGIN_S = 5.0  # for a machine under load; benchmarks/rtsp_faults.py measures how soon faults are noticed
Serve = Callable[[int], int]
Close = Callable[[int], int]


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[tuple[int, Path]]:
    """The port of a real server with the paths h264 and h265, and the folder it records to."""
    if not Path(SYSTEM_PYTHON).exists():
        pytest.skip("no system Python: the RTSP server of these tests runs in it")
    probe = subprocess.run(
        [SYSTEM_PYTHON, "-c", HAS_RTSP_SERVER], capture_output=True, timeout=30, check=False
    )
    if probe.returncode:
        pytest.skip("no gst-rtsp-server: install gir1.2-gst-rtsp-server-1.0 gstreamer1.0-plugins-good")
    command = [SYSTEM_PYTHON, str(RTSP_SERVER), str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        yield int(process.stdout.readline()), tmp_path
        process.kill()


@pytest.fixture
def closing_server() -> Iterator[Close]:
    """Starts a server that takes a recording and closes after n interleaved packets; its port."""
    with ExitStack() as stack:

        def start(count: int) -> int:
            listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            thread = threading.Thread(target=_record, args=(listener, count))
            thread.start()
            stack.callback(thread.join, 10.0)
            stack.callback(listener.shutdown, socket.SHUT_RDWR)
            return int(listener.getsockname()[1])

        yield start


def _record(listener: socket.socket, count: int) -> None:
    while True:
        try:
            connection = listener.accept()[0]
        except OSError:
            return
        with connection, connection.makefile("rwb") as stream:
            connection.settimeout(10)
            while line := stream.readline():
                head = [line]
                while (line := stream.readline()).strip():
                    head.append(line)
                text = b"".join(head).decode()
                if length := re.search(r"(?i)content-length: (\d+)", text):
                    stream.read(int(length[1]))
                transport = re.search(r"Transport: .*\r\n", text)
                reply = "RTSP/1.0 200 OK\r\n" + re.findall(r"CSeq: .*\r\n", text)[0] + "Session: 1\r\n"
                stream.write((reply + (transport[0] if transport else "") + "\r\n").encode())
                stream.flush()
                if text.startswith("RECORD"):
                    break
            for _ in range(count):
                stream.read(int.from_bytes(stream.read(4)[2:], "big"))


def children() -> list[str]:
    """The child processes of this one that still exist, zombies included."""
    found = []
    for task in Path("/proc/self/task").iterdir():
        with suppress(OSError):  # a thread that has ended meanwhile
            found += (task / "children").read_text(encoding="ascii").split()
    return found


def pipes() -> int:
    """How many pipes are open here; sockets are the servers' of these tests."""
    links = []
    for descriptor in os.listdir("/proc/self/fd"):
        with suppress(FileNotFoundError):  # the one that lists
            links.append(os.readlink(f"/proc/self/fd/{descriptor}"))
    return sum(link.startswith("pipe:") for link in links)


def fails(text: str) -> tuple[str, float]:
    """The error a pipeline ends in, and after how many seconds."""
    began = time.monotonic()
    with pytest.raises(ElementFailure) as caught:
        Pipeline.parse(text).run(timeout_s=20)
    return str(caught.value), time.monotonic() - began


def coded(codec: str, count: int) -> list[Frame]:
    """Packets of frames that move, as `encode` gives them, a keyframe every ten."""
    text = (
        f"videotestsrc num-buffers={count} pattern=ball ! video/x-raw, width=320, height=240, framerate=25/1"
    )
    with Pipeline.parse(f"{text} ! encode codec={codec} gop=10 live=true ! appsink name=out") as pipeline:
        pipeline.play()
        return list(pipeline["out"])


def video_frames(source: Path | list[Frame], codec: str) -> list[bytes]:
    """The luma planes that a recording, or packets, decode to."""
    if isinstance(source, Path):
        with av.open(str(source), format=codec) as container:
            return [bytes(video_frame.planes[0]) for video_frame in container.decode(video=0)]
    context = av.CodecContext.create(codec, "r")
    context.extradata = bytes.fromhex(str(source[0].caps.get("codec_data", "")))
    packets = [av.Packet(bytes(frame.data)) for frame in source]
    decoded = [video_frame for packet in [*packets, None] for video_frame in context.decode(packet)]
    return [bytes(video_frame.planes[0]) for video_frame in decoded]


@pytest.mark.parametrize(("codec", "transport"), [("h264", "tcp"), ("h264", "udp"), ("h265", "tcp")])
def test_a_real_server_records_the_same_frames(
    recording: tuple[int, Path], codec: str, transport: str
) -> None:
    """Every packet of a stream arrives, and decodes to the frames it was."""
    port, folder = recording
    frames = coded(codec, 30)
    properties = {"location": f"rtsp://127.0.0.1:{port}/{codec}", "transport": transport}
    with Harness("rtspclientsink", user_id="user", user_pw="secret", latency=1500, **properties) as harness:
        for frame in frames:
            harness.push(frame)
        harness.drain()
        element = harness.element
        assert (element.sent, element.drops) == (30, {})
    name = {"h264": "h264", "h265": "hevc"}[codec]
    assert video_frames(folder / codec, name) == video_frames(frames, name)


def test_packets_of_a_file_arrive(recording: tuple[int, Path], make_video: Callable[..., Path]) -> None:
    """Length-prefixed packets with B-frames, their headers in codec_data, become a stream that decodes."""
    port, folder = recording
    source = make_video("pushed.mp4", count=25)
    sink = f"rtspclientsink location=rtsp://user:secret@127.0.0.1:{port}/h264 latency=1500"
    Pipeline.parse(f"filesrc location={source} ! {sink} sync=true").run(timeout_s=20)
    with av.open(str(source)) as container:
        before = [bytes(video_frame.planes[0]) for video_frame in container.decode(video=0)]
    assert video_frames(folder / "h264", "h264") == before


@pytest.mark.parametrize(
    ("user", "path", "reason"), [("user:wrong", "h264", "credentials"), ("user:secret", "nosuch", "404")]
)
def test_a_refusal_is_reported(recording: tuple[int, Path], user: str, path: str, reason: str) -> None:
    """A wrong password and a wrong path give different errors, without the password."""
    error, elapsed = fails(f"{NOT_PACED} location=rtsp://{user}@127.0.0.1:{recording[0]}/{path}")
    assert reason in error
    assert user.partition(":")[2] not in error
    assert elapsed < 2 + MARGIN_S


@pytest.mark.parametrize("answers", [0, 1])
@pytest.mark.parametrize("transport", ["tcp", "udp"])
def test_a_silent_server_is_noticed(serve: Serve, answers: int, transport: str) -> None:
    """Silence ends in one error within timeout-s + 1 s, and nothing of the process stays."""
    location = f"rtsp://me:secret@127.0.0.1:{serve(answers)}/live"
    error, elapsed = fails(f"{NOT_PACED} location={location} transport={transport} timeout-s=2")
    assert "rtsp://***@" in error
    assert "the server has been silent for 2 s" in error
    assert "secret" not in error
    assert elapsed < 2 + MARGIN_S
    assert not children()


def test_waiting_for_a_slow_server_can_be_stopped(serve: Serve) -> None:
    """While max-packets are queued the sink waits up to timeout-s; the watchdog does not end it."""
    text = f"{NOT_PACED} location=rtsp://127.0.0.1:{serve(0)}/live timeout-s=3 max-packets=1"
    with (
        pytest.raises(ElementFailure, match="the server has been silent for 3 s"),
        Pipeline.parse(text, watchdog_s=1.0) as pipeline,
    ):
        pipeline.run(30)


def test_a_closed_port_is_reported() -> None:
    """A refused connection gives its reason at once."""
    error, elapsed = fails(f"{NOT_PACED} location=rtsp://me:secret@127.0.0.1:1/live")
    assert re.search(r"rtsp://\*\*\*@127.0.0.1:1/live: no recording there: Connection refused; check", error)
    assert elapsed < 2 + MARGIN_S
    assert not children()


def test_an_unknown_host_is_named() -> None:
    """FFmpeg calls it an input/output error."""
    error, _ = fails(f"{NOT_PACED} location=rtsp://no-such-host.invalid/live")
    assert "the host name 'no-such-host.invalid' is not known here; check address" in error


def test_a_server_that_closes_is_reported(closing_server: Close) -> None:
    """A connection closed amid the stream is one error, without reconnecting."""
    location = f"rtsp://127.0.0.1:{closing_server(5)}/live"
    error, elapsed = fails(f"{NOT_PACED} location={location} reconnect=never timeout-s=2")
    assert "the server has ended the connection" in error
    assert elapsed < 2 + MARGIN_S
    assert not children()


def test_it_connects_again(closing_server: Close) -> None:
    """A server that closes is connected again, from a keyframe each time; every packet is counted."""
    location = f"rtsp://127.0.0.1:{closing_server(3)}/live"
    harness = Harness("rtspclientsink", location=location, retry_delay_s=0.0, max_retries=3, timeout_s=10.0)
    frames = coded("h264", 40)
    pushed = 0
    failure = None
    with harness:
        while failure is None:
            try:
                harness.push(frames[pushed % len(frames)])
            except ElementFailure as error:
                failure = error
            pushed += 1
    assert "gave up after 3 retries" in str(failure)
    states = [m.fields["state"] for m in harness.messages if m.kind is MessageKind.ELEMENT]
    assert states.count("connecting") == states.count("connected") == 4
    assert states[-1] == "gave-up"
    assert harness.element.sent + sum(harness.element.drops.values()) == pushed
    assert not children()


def test_what_a_slow_server_does_not_take_is_dropped(serve: Serve) -> None:
    """With drop=true frames never wait; beyond max-packets they are dropped and counted."""
    location = f"rtsp://127.0.0.1:{serve(0)}/live"
    frames = coded("h264", 30)
    with Harness("rtspclientsink", location=location, drop=True, max_packets=4, timeout_s=60.0) as harness:
        began = time.monotonic()
        for frame in frames:
            harness.push(frame)
        assert time.monotonic() - began < MARGIN_S
        assert harness.element.drops == {"the server is too slow": 26}


def test_no_password_is_in_the_list_of_processes(serve: Serve) -> None:
    """The process that pushes has neither the address nor the password among its arguments or variables."""
    location = f"rtsp://me:hidden-word@127.0.0.1:{serve(0)}/live"
    with Harness("rtspclientsink", location=location, timeout_s=60.0) as harness:
        harness.push(coded("h264", 1)[0])
        (child,) = children()
        for name in ("cmdline", "environ"):
            assert b"hidden-word" not in Path(f"/proc/{child}/{name}").read_bytes()
    graph = Pipeline.parse(f"{NOT_PACED} location={location}")
    assert str(graph["out"].properties_set()["location"]).startswith("rtsp://***@")


def test_starts_and_stops_leave_nothing(closing_server: Close) -> None:
    """After each of ten connections and stops, processes, threads and pipes are as before the first."""
    location = f"rtsp://127.0.0.1:{closing_server(1000)}/live"
    frames = coded("h264", 2)
    before = (children(), threading.active_count(), pipes())
    for _ in range(10):
        with Harness("rtspclientsink", location=location, max_packets=1, timeout_s=10.0) as harness:
            harness.push(frames[0])
            harness.push(frames[1])  # waits until the server has taken the first
            assert harness.element.sent == 1
        assert (children(), threading.active_count(), pipes()) == before


@pytest.mark.parametrize("location", ["", "cam/live", "http://u:secret@cam/live", "rtsp://cam:port/x"])
def test_other_locations_fail_before_playing(location: str) -> None:
    """A location that is not an RTSP URL is refused when the element starts, with an example."""
    pipeline = Pipeline.parse(f'{NOT_PACED} location="{location}"')
    with pytest.raises(ElementFailure, match=r"write (location=)?rtsp://host:port/path") as caught:
        pipeline.ready()
    pipeline.stop()
    assert "secret" not in str(caught.value)


def test_it_begins_with_a_key_frame(serve: Serve) -> None:
    """Packets before the first keyframe are dropped and counted."""
    frame = Frame(b"\0\0\0\1\x41", Caps("video/x-h264, width=64, height=48"), pts=0, flags=FrameFlags.NONE)
    with Harness("rtspclientsink", location=f"rtsp://127.0.0.1:{serve(0)}/live") as harness:
        harness.push(frame)
        assert harness.element.drops == {"before the first keyframe": 1}
