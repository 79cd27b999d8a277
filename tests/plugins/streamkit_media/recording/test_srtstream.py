"""packetsink and videofilesink over SRT, with real receivers."""

import shutil
import signal
import subprocess
import sys
import threading
import time
from itertools import islice
from pathlib import Path
from unittest.mock import Mock

import pytest

from streamkit import ElementFailure, FrameFlags, MessageKind, Pipeline
from streamkit.output.pipe import ReaderWait
from streamkit_media.ffmpegprogram import has_srt
from streamkit_media.live.endpoint import Reconnect
from streamkit_media.recording.srtstream import SrtStream, entry_point
from tests.child_programs import programs_at
from tests.slowness import patience
from tests.waiting import next_state

FFMPEG = shutil.which("ffmpeg") or ""
PASSPHRASE = "flight-of-1903"
PICTURES = "videotestsrc is-live=true ! video/x-raw,framerate=25/1 ! videofilesink"

pytestmark = [
    pytest.mark.timeout(90),
    pytest.mark.skipif(
        not FFMPEG or not has_srt(FFMPEG), reason="no ffmpeg with SRT: apt-get install ffmpeg"
    ),
]


def senders(port: int) -> list[int]:
    """Processes that send to or from a port, also such as have ended and are not reaped."""
    return programs_at(port, b"pipe:0")


def failure(text: str) -> str:
    """The text of the error in which a pipeline ends."""
    with Pipeline.parse(text) as pipeline, pytest.raises(ElementFailure) as caught:
        pipeline.run()
    return str(caught.value)


@pytest.mark.parametrize("calls", [True, False])
def test_livesrc_receives_video_and_telemetry(clip: Path, port: int, *, calls: bool) -> None:
    """The sink calls, or is called; encrypted, and without a frame that is damaged."""
    caller = f"srt://127.0.0.1:{port}?passphrase={PASSPHRASE}&connect_timeout=30000"
    listener = f"srt://127.0.0.1:{port}?passphrase={PASSPHRASE}&mode=listener"
    receive_at, send_to = (listener, caller) if calls else (caller, listener)
    receive = (
        f'livesrc name=s uri="{receive_at}" timeout-s=40  s.src ! decode ! appsink name=out '
        "max-buffers=0  s.klv ! appsink name=klv max-buffers=0"
    )
    send = f'filesrc name=s location={clip}  s.video ! packetsink name=p sync=true location="{send_to}" '
    with Pipeline.parse(receive) as receiver:
        receiver.play()
        next_state(receiver, "connecting")
        with Pipeline.parse(f"{send} timeout-s=40 s.klv ! p.klv") as sender:
            sender.play()
            frames = list(islice(receiver["out"], 60))
            telemetry = list(islice(receiver["klv"], 50))
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)
    assert len({bytes(packet.data) for packet in telemetry}) == 50
    assert not senders(port)


def test_gstreamer_receives_what_is_encoded_here(port: int) -> None:
    """The other program that speaks SRT decodes sixty frames; it leaves, which is an error here."""
    if (
        not shutil.which("gst-inspect-1.0")
        or subprocess.run(["gst-inspect-1.0", "srtsrc"], capture_output=True, check=False).returncode
    ):
        pytest.skip("no srtsrc: install gstreamer1.0-tools and the plugins good, bad and libav")
    words = f"srtsrc uri=srt://127.0.0.1:{port}?mode=listener ! tsdemux ! h264parse ! avdec_h264 ! "
    command = ["gst-launch-1.0", "-q", *words.split(), *["identity", "eos-after=60", "!", "fakesink"]]
    with subprocess.Popen(command) as receiver:
        try:
            location = f"srt://127.0.0.1:{port}?connect_timeout=30000"
            text = failure(f"{PICTURES} location={location} reconnect=never")
            assert receiver.wait(patience(30)) == 0
        finally:
            receiver.kill()
    assert "cannot be written: no connection to a receiver: " in text
    assert not senders(port)


def test_a_stop_amid_the_stream_is_no_error(port: int) -> None:
    """The thread that has begun the connection ends before the sink does."""
    warnings: list[str] = []
    receive = f'livesrc uri="srt://127.0.0.1:{port}?mode=listener" timeout-s=40 ! appsink name=out'
    send = f'{PICTURES} timeout-s=40 location="srt://127.0.0.1:{port}?connect_timeout=30000"'
    with Pipeline.parse(receive) as receiver:
        receiver.play()
        with Pipeline.parse(send) as sender:
            sender.bus.watch(
                lambda message: warnings.append(message.text) if message.kind is MessageKind.WARNING else None
            )
            sender.play()
            assert len(list(islice(receiver["out"], 10))) == 10
    assert warnings == []
    assert not senders(port)


@pytest.mark.parametrize("calls", [True, False])
def test_a_receiver_that_comes_back_gets_the_stream(port: int, *, calls: bool) -> None:
    """The sink calls it again, or is called; what was made meanwhile is lost, and counted."""
    caller, listener = (
        f"srt://127.0.0.1:{port}?connect_timeout=30000",
        f"srt://127.0.0.1:{port}?mode=listener",
    )
    receive_at, send_to = (listener, caller) if calls else (caller, listener)
    receive = f'livesrc uri="{receive_at}" timeout-s=40 reconnect=always ! decode ! appsink name=out'
    with Pipeline.parse(f'{PICTURES} name=sink timeout-s=40 location="{send_to}"') as sender:
        with Pipeline.parse(receive) as receiver:
            receiver.play()
            next_state(receiver, "connecting")
            sender.play()
            assert len(list(islice(receiver["out"], 10))) == 10
        retrying = next_state(sender, "retrying")
        with Pipeline.parse(receive) as receiver:
            receiver.play()
            frames = list(islice(receiver["out"], 30))
        next_state(sender, "connected")
        assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)
        assert sender["sink"].results["lost_connections"] >= 1
        assert sender["sink"].results["lost_bytes"] > 0
    assert "no connection to a receiver: " in str(retrying.fields["reason"])
    assert not senders(port)


def test_a_first_receiver_is_awaited_where_that_is_wanted(port: int) -> None:
    """With reconnect=always; the stop ends a try."""
    text = f"{PICTURES} reconnect=always location=srt://127.0.0.1:{port}?connect_timeout=500"
    with Pipeline.parse(text) as sender:
        sender.play()
        next_state(sender, "retrying")
        next_state(sender, "retrying")
        warning = sender.bus.pop(0, (MessageKind.WARNING,))
    assert warning is None or "what comes meanwhile is lost; trying again in" in warning.text
    assert not senders(port)


def test_nobody_there_is_an_error_without_the_secret(port: int) -> None:
    """The sink calls, and says what became of it, also where its stream was short."""
    location = f"srt://127.0.0.1:{port}?passphrase=secret-secret&connect_timeout=500"
    for count in (-1, 5):
        text = failure(f'videotestsrc num-buffers={count} ! videofilesink sync=true location="{location}"')
        assert "cannot be written: no connection to a receiver: " in text
        assert "check the address, and that the receiver runs" in text
        assert "secret" not in text
    assert not senders(port)


def test_a_wrong_passphrase_is_told_and_not_shown(port: int) -> None:
    """The receiver has another one."""
    command = [FFMPEG, "-loglevel", "quiet", "-nostdin", "-f", "data", "-i"]
    command += [f"srt://127.0.0.1:{port}?mode=listener&passphrase={PASSPHRASE}", "-f", "null", "-"]
    with subprocess.Popen(command) as receiver:
        try:
            deadline = time.monotonic() + patience(10)
            while f":{port:04X}" not in Path("/proc/net/udp").read_text():
                assert time.monotonic() < deadline
                time.sleep(0.02)
            text = failure(f'{PICTURES} location="srt://127.0.0.1:{port}?passphrase=wrong-secret"')
        finally:
            receiver.kill()
    assert "no connection to a receiver: it refuses the passphrase; check" in text
    assert "secret" not in text


def test_a_wait_for_a_receiver_has_a_limit(port: int) -> None:
    """A listener without a caller."""
    pictures = PICTURES.replace("videotestsrc", "videotestsrc pattern=snow")  # fills the pipe soon
    text = failure(f'{pictures} timeout-s=0.5 location="srt://:{port}?mode=listener"')
    assert "its reader has taken nothing for 0.5 s" in text
    assert not senders(port)


def test_ctrl_c_ends_a_wait_for_a_receiver(port: int) -> None:
    """Within the second that a stop allows, whatever the limit; nothing is left running."""
    text = f'{PICTURES} timeout-s=600 location="srt://:{port}?mode=listener"'
    with subprocess.Popen(
        [sys.executable, "-m", "streamkit", "launch", text], stderr=subprocess.DEVNULL
    ) as process:
        try:
            deadline = time.monotonic() + patience(30)
            while not senders(port):
                assert time.monotonic() < deadline
                time.sleep(0.02)
            process.send_signal(signal.SIGINT)
            process.wait(patience(10))
        finally:
            process.kill()
    assert not senders(port)


TABLE, OTHER = b"\x47\x40\0\x10" + bytes(184), b"\x47\x01\0\x10" + bytes(184)
KEYFRAME = b"\x47\x41\0\x30\x07\x50" + bytes(182)
DELAYED = b"\x47\x41\0\x30\x07\x10" + bytes(182)  # with a clock, and no keyframe


@pytest.mark.parametrize(
    ("packets", "expected"),
    [
        ([OTHER, TABLE, OTHER, KEYFRAME, TABLE], 1),
        ([OTHER, DELAYED, KEYFRAME], 2),
        ([TABLE, OTHER, DELAYED], None),
        ([], None),
    ],
)
def test_a_stream_is_entered_at_a_keyframe(packets: list[bytes], expected: int | None) -> None:
    """With the table before it; a packet that is cut at the beginning or end is none."""
    data = bytes(50) + b"".join(packets) + KEYFRAME[:100]
    assert entry_point(data, 50) == (None if expected is None else 50 + 188 * expected)


def test_what_cannot_be_written_starts_nothing(port: int) -> None:
    """A stream that is refused before its first byte leaves no program that waits for the rest."""
    ignore = Mock()
    stream = SrtStream(f"srt://127.0.0.1:{port}", ReaderWait(), Reconnect.NEVER, ignore, ignore)
    stream.finish()
    stream.abandon()
    assert not senders(port)


def test_no_program_is_told_before_playing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With what to install."""
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    monkeypatch.setenv("PATH", str(tmp_path))
    pipeline = Pipeline.parse("videotestsrc ! videofilesink location=srt://drone:9000")
    with pytest.raises(ElementFailure, match=r"install ffmpeg, or streamkit\[srt\]"):
        pipeline.ready()
    pipeline.stop()
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("reader")]
