"""livesrc over SRT: real senders that call and are called, fall silent, come back and refuse."""

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import islice, pairwise
from pathlib import Path

import pytest

from streamkit import ElementFailure, FrameFlags, Pipeline
from streamkit_media.doctor.examine import examine
from streamkit_media.failures import AccessRefused, ConnectionLost
from streamkit_media.ffmpegprogram import has_srt
from streamkit_media.live.srtinput import SrtInput
from tests.child_programs import programs_at
from tests.waiting import next_state

MARGIN_S = 5.0  # for a machine under load
PASSPHRASE = "flight-of-1903"
FFMPEG = shutil.which("ffmpeg") or ""
Start = Callable[..., subprocess.Popen[bytes]]

pytestmark = [
    pytest.mark.timeout(90),
    pytest.mark.skipif(
        not FFMPEG or not has_srt(FFMPEG), reason="no ffmpeg with SRT: apt-get install ffmpeg"
    ),
]


def kill(process: subprocess.Popen[bytes]) -> None:
    """Kills a sender and what it has started, as a drone that is switched off."""
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait(10)


@pytest.fixture
def start_srt(clip: Path) -> Iterator[Start]:
    """Starts a sender of the clip in real time, which tries again after an end; its argument is the URL."""
    with ExitStack() as stack:

        def start(url: str) -> subprocess.Popen[bytes]:
            command = [FFMPEG, "-loglevel", "quiet", "-nostdin", "-re", "-stream_loop", "-1", "-i", str(clip)]
            command += ["-map", "0", "-c", "copy", "-f", "mpegts", url]
            again = ["/bin/sh", "-c", 'while :; do "$@"; sleep 0.1; done', "sender"]
            process = subprocess.Popen([*again, *command], start_new_session=True)
            stack.callback(kill, process)
            return process

        yield start


def calling(port: int, options: str = "") -> str:
    """The URL of a sender that calls until there is a listener."""
    return f"srt://127.0.0.1:{port}?connect_timeout=30000{options}"


def receivers(port: int) -> list[int]:
    """Processes that receive at a port, also such as have ended and are not reaped."""
    return programs_at(port, b"pipe:1")


def is_left(port: int) -> bool:
    """Whether a thread that reads or a program that receives is left, or one that is not reaped."""
    threads = [thread for thread in threading.enumerate() if thread.name.startswith("reader")]
    return bool(threads or receivers(port))


def wait_until(condition: Callable[[], object], limit_s: float) -> None:
    """Waits for what another process does."""
    deadline = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def failure(uri: str, properties: str = "") -> str:
    """The text of the error in which a pipeline ends."""
    with Pipeline.parse(f'livesrc uri="{uri}" {properties} ! fakesink') as pipeline:
        with pytest.raises(ElementFailure) as caught:
            pipeline.run()
        return str(caught.value)


class Recording(SrtInput):
    """Keeps what FFmpeg reads."""

    seen = b""

    def read(self, size: int) -> bytes:
        """The next bytes."""
        data = super().read(size)
        self.seen += data
        return data


def test_bytes_pass_unchanged(clip: Path, port: int) -> None:
    """Telemetry and times are those of the sender; its end is a lost connection."""
    data = clip.read_bytes() * 4
    command = [FFMPEG, "-loglevel", "quiet", "-f", "data", "-i", "pipe:0", "-map", "0", "-c", "copy"]
    command += ["-flush_packets", "1", "-f", "data", calling(port)]
    source = Recording(f"srt://127.0.0.1:{port}?mode=listener", 20.0, low_latency=True)

    def send() -> None:
        with subprocess.Popen(command, stdin=subprocess.PIPE) as sender:
            assert sender.stdin is not None
            for at in range(0, len(data), 1316):
                sender.stdin.write(data[at : at + 1316])
                sender.stdin.flush()
                time.sleep(0.002)  # the pace of a stream: a flood overflows the buffers of SRT

    thread = threading.Thread(target=send)
    thread.start()
    try:
        with source.open() as container, pytest.raises(ConnectionLost, match="check that it still runs"):
            for _ in source.packets(container, [source.video_of(container)]):
                pass
    finally:
        source.close()
        thread.join(30)
    assert len(source.seen) > len(data) // 2  # SRT lets go of what is under way when the sender ends
    assert source.seen == data[: len(source.seen)]


def test_a_sender_that_listens_is_called(start_srt: Start, port: int) -> None:
    """Encrypted: all frames come in order, with telemetry; nothing is left running."""
    start_srt(f"srt://127.0.0.1:{port}?mode=listener&passphrase={PASSPHRASE}")
    with Pipeline.parse(
        f'livesrc name=s uri="srt://127.0.0.1:{port}?passphrase={PASSPHRASE}" reconnect=always ! decode ! '
        "appsink name=out  s.klv ! appsink name=klv"
    ) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 60))
        assert next(iter(pipeline["klv"])).data.size
        assert receivers(port)
    assert frames[-1].data.shape[1] == 64
    assert [frame.seq for frame in frames] == sorted({frame.seq for frame in frames})
    assert all(a.pts < b.pts for a, b in pairwise(frames))
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames[20:])
    assert not is_left(port)


def test_gstreamers_sender_calls(start_gstreamer: Start, port: int) -> None:
    """The other program that speaks SRT, and the other direction of the call."""
    if subprocess.run(["gst-inspect-1.0", "srtsink"], capture_output=True, check=False).returncode:
        pytest.skip("no srtsink: install gstreamer1.0-plugins-bad")
    with Pipeline.parse(
        f'livesrc uri="srt://:{port}?mode=listener" reconnect=always ! decode ! appsink name=out'
    ) as pipeline:
        pipeline.play()
        next_state(pipeline, "connecting")
        start_gstreamer("mpegtsmux alignment=7", f"srtsink uri=srt://127.0.0.1:{port}?mode=caller")
        frames = list(islice(pipeline["out"], 60))
    assert frames[-1].data.shape == (240, 320)
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames[20:])
    assert not is_left(port)


@pytest.mark.parametrize("is_listener", [True, False])
def test_a_sender_that_is_killed_comes_back(start_srt: Start, port: int, *, is_listener: bool) -> None:
    """It is a new epoch, and times go on."""
    called = f"srt://127.0.0.1:{port}?mode=listener"
    uri, sender_url = (called, calling(port)) if is_listener else (f"srt://127.0.0.1:{port}", called)
    first = start_srt(sender_url)
    with Pipeline.parse(
        f'livesrc uri="{uri}" reconnect=always timeout-s=2 max-retry-delay-s=0.5 ! appsink name=out'
    ) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 10))
        kill(first)
        next_state(pipeline, "retrying")
        start_srt(sender_url)
        for frame in pipeline["out"]:
            frames.append(frame)
            if frame.epoch > frames[0].epoch:
                break
    assert frames[-1].epoch == frames[0].epoch + 1
    assert all(a.pts < b.pts for a, b in pairwise(frames))
    assert not is_left(port)


def test_a_wrong_passphrase_is_refused_and_not_shown(start_srt: Start, port: int) -> None:
    """It says so at once, also where every failure is tried again; no secret is in it."""
    start_srt(f"srt://127.0.0.1:{port}?mode=listener&passphrase={PASSPHRASE}")
    wait_until(lambda: f":{port:04X}" in Path("/proc/net/udp").read_text(), MARGIN_S)
    uri = f"srt://127.0.0.1:{port}?passphrase=wrong-secret&streamid=cam-secret"
    source = SrtInput(uri, 10.0, low_latency=True)
    with pytest.raises(AccessRefused, match="refuses the passphrase; write the one it has") as caught:
        source.open()
    source.close()
    assert "secret" not in str(caught.value)
    text = failure(uri, "reconnect=always")
    assert "refuses the passphrase" in text
    assert "secret" not in text
    assert not is_left(port)


def test_a_passphrase_that_cannot_be_one_is_not_shown(port: int) -> None:
    """The program's own words name the fault, without the secret."""
    text = failure(f"srt://127.0.0.1:{port}?passphrase=secret", "timeout-s=10")
    assert "no connection: " in text
    assert "SRTO_PASSPHRASE" in text
    assert "secret" not in text


@pytest.mark.parametrize("mode", ["caller", "listener"])
def test_nothing_there_ends_within_the_limit(port: int, mode: str) -> None:
    """There is no listener to call, or no caller comes."""
    began = time.monotonic()
    text = failure(f"srt://127.0.0.1:{port}?mode={mode}", "timeout-s=1")
    assert time.monotonic() - began < 1 + MARGIN_S
    assert "no video within 1 s (timeout-s)" in text
    assert ("nobody has sent here" in text) == (mode == "listener")
    assert not is_left(port)


def test_stop_ends_a_wait_at_once(port: int) -> None:
    """The time limit has no part in it."""
    with Pipeline.parse(f'livesrc uri="srt://:{port}?mode=listener" timeout-s=60 ! fakesink') as pipeline:
        pipeline.play()
        wait_until(lambda: receivers(port), MARGIN_S)
        began = time.monotonic()
    assert time.monotonic() - began < MARGIN_S
    assert not is_left(port)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_nothing_is_left_when_the_process_ends(port: int, number: signal.Signals) -> None:
    """By Ctrl-C in a terminal, and by force."""
    text = f'livesrc uri="srt://:{port}?mode=listener" timeout-s=60 ! fakesink'
    command = [sys.executable, "-m", "streamkit", "launch", text]
    with subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        try:
            wait_until(lambda: receivers(port), 30)
            process.send_signal(number)
            process.wait(MARGIN_S)
        finally:
            process.kill()
    wait_until(lambda: not receivers(port), MARGIN_S)


def test_doctor_looks_at_it(start_srt: Start, port: int) -> None:
    """Its line of a pipeline reads the same URL."""
    start_srt(f"srt://127.0.0.1:{port}?mode=listener")
    report = examine(f"srt://127.0.0.1:{port}", seconds=1.0, timeout_s=10.0, transport="tcp")
    assert f"livesrc name=s uri=srt://127.0.0.1:{port}" in report.pipeline
    assert not is_left(port)
