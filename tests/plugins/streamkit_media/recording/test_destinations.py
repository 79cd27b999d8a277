"""packetsink and videofilesink to the standard output, over UDP and as HLS, with real receivers."""

import fcntl
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import termios
import time
from itertools import islice
from pathlib import Path

import av
import pytest

from streamkit import DescriptionError, ElementFailure, FrameFlags, MessageKind, Pipeline
from streamkit_media.udp import UdpAddress, target_address
from tests.slowness import patience

COMMAND = [sys.executable, "-c", "from streamkit.cli.main import main; main()", "launch"]
WITH_TELEMETRY = "filesrc name=s location={}  s.video ! packetsink name=p {}  s.klv ! p.klv"


def count_packets(path: Path) -> dict[str, int]:
    """Number of packets by the stream's kind, of a file or playlist."""
    with av.open(str(path)) as container:
        found: dict[str, int] = {}
        for packet in container.demux():
            if packet.size:
                found[packet.stream.type] = found.get(packet.stream.type, 0) + 1
        return found


def run(pipeline: Pipeline) -> list[str]:
    """Plays a pipeline to its end; its warnings."""
    found: list[str] = []
    pipeline.bus.watch(
        lambda message: found.append(message.text) if message.kind is MessageKind.WARNING else None
    )
    pipeline.run(timeout_s=20)
    return found


def test_the_standard_output_holds_nothing_but_the_stream(clip: Path) -> None:
    """Counters and the summary, which otherwise stand there, go to stderr."""
    text = WITH_TELEMETRY.format(clip, "location=-")
    done = subprocess.run(
        [*COMMAND, "--summary=json", "--stats=json", text],
        capture_output=True, timeout=patience(60), check=True,
    )  # fmt: skip
    assert len(done.stdout) % 188 == 0
    assert set(done.stdout[::188]) == {0x47}
    rows = [json.loads(line) for line in done.stderr.splitlines() if line.startswith(b"{")]
    assert [row["schema"] for row in rows] == ["streamkit.statistics/1", "streamkit.summary/1"]


def test_ffmpeg_reads_what_comes_through_a_pipe(clip: Path) -> None:
    """Video encoded here, and packets with their telemetry, while they come."""
    for text, kinds in (
        (WITH_TELEMETRY.format(clip, "location=-"), {"video": 100, "data": 100}),
        ("videotestsrc num-buffers=50 ! videofilesink location=-", {"video": 50}),
    ):
        with (
            subprocess.Popen([*COMMAND, "-q", text], stdout=subprocess.PIPE) as process,
            av.open(process.stdout, format="mpegts") as container,
        ):
            found = [packet.stream.type for packet in container.demux() if packet.size]
        assert {kind: found.count(kind) for kind in set(found)} == kinds
        assert process.returncode == 0


def test_a_reader_that_stops_is_an_error() -> None:
    """It names the output, the rule and the remedy."""
    text = "videotestsrc ! videofilesink location=- timeout-s=0.5"
    with subprocess.Popen([*COMMAND, text], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.wait(patience(60)) == 1
        assert process.stderr is not None
        said = process.stderr.read().decode()
    assert "location=-: cannot be written: its reader has taken nothing for 0.5 s; let it read on" in said
    assert "timeout-s=" in said


def test_ctrl_c_ends_a_run_whose_reader_has_stopped() -> None:
    """At once, whatever the limit."""
    text = "videotestsrc ! videofilesink location=- timeout-s=600"
    with subprocess.Popen([*COMMAND, text], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        held = -1
        while (now := waiting_bytes(process.stdout.fileno())) == 0 or now != held:
            held = now
            time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        began = time.monotonic()
        assert process.wait(patience(20)) == 0
        assert time.monotonic() - began < patience(5)


def waiting_bytes(descriptor: int) -> int:
    """What a pipe holds, bytes."""
    return int.from_bytes(fcntl.ioctl(descriptor, termios.FIONREAD, bytes(4)), sys.byteorder)


def test_a_terminal_is_no_output(tmp_path: Path) -> None:
    """Video on a terminal is of no use."""
    leader, follower = os.openpty()
    text = "videotestsrc num-buffers=1 ! videofilesink location=-"
    done = subprocess.run(
        [*COMMAND, text], stdout=follower, stderr=subprocess.PIPE, timeout=patience(60), check=False
    )
    os.close(leader), os.close(follower)
    assert done.returncode == 1
    assert b"location=- is a terminal, which shows no video; write it to a program" in done.stderr


def test_udp_brings_video_and_telemetry_to_livesrc(clip: Path, port: int) -> None:
    """The receiver is there first; nothing is lost or refused, and every KLV packet comes."""
    receive = (
        f"livesrc name=s uri=udp://127.0.0.1:{port} timeout-s=20  s.src ! decode ! appsink name=out "
        "max-buffers=0  s.klv ! appsink name=klv max-buffers=0"
    )
    send = WITH_TELEMETRY.format(clip, f"location=udp://127.0.0.1:{port} sync=true")
    with Pipeline.parse(receive) as receiver:
        receiver.play()
        while (message := receiver.bus.pop(20, (MessageKind.ELEMENT,))) is not None:
            if message.fields.get("state") == "connecting":
                break
        with Pipeline.parse(send) as sender:
            sender.play()
            frames = list(islice(receiver["out"], 80))
            telemetry = list(islice(receiver["klv"], 70))
        assert (receiver["s"].lost, receiver["s"].refused) == (0, 0)
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)
    assert len({bytes(packet.data) for packet in telemetry}) == 70


@pytest.mark.parametrize("address", ["udp://127.0.0.1:{}", "udp://239.1.2.3:{}?localaddr=127.0.0.1&ttl=2"])
def test_who_joins_late_sees_the_next_keyframe(port: int, address: str) -> None:
    """Frames encoded here are decoded by a receiver, or a member of a group, that begins a second later."""
    location = address.format(port)
    text = f"videotestsrc is-live=true ! video/x-raw,framerate=25/1 ! videofilesink location={location}"
    with Pipeline.parse(text) as sender:
        sender.play()
        url = location.removesuffix("&ttl=2")
        with Pipeline.parse(f"livesrc uri={url} timeout-s=20 ! decode ! appsink name=out") as receiver:
            receiver.play()
            frames = list(islice(receiver["out"], 60))
    corrupt = [bool(frame.flags & FrameFlags.CORRUPT) for frame in frames]
    assert not any(corrupt[corrupt.index(False) :])
    assert sum(corrupt) <= 25


def test_gstreamer_receives_the_datagrams(port: int) -> None:
    """Udpsrc ! tsdemux decodes sixty frames."""
    if shutil.which("gst-launch-1.0") is None:
        pytest.skip("no GStreamer: install gstreamer1.0-tools and the plugins good, bad and libav")
    words = f"udpsrc port={port} ! tsdemux ! h264parse ! avdec_h264 ! identity eos-after=60 ! fakesink"
    text = f"videotestsrc is-live=true ! video/x-raw,framerate=60/1 ! videofilesink location=udp://127.0.0.1:{port}"
    with Pipeline.parse(text) as sender:
        sender.play()
        subprocess.run(["gst-launch-1.0", "-q", *words.split()], timeout=patience(60), check=True)


def test_without_a_receiver_the_run_goes_on(port: int) -> None:
    """What cannot be sent is counted, and warned of once."""
    text = f"videotestsrc num-buffers=50 ! videofilesink name=out location=udp://127.0.0.1:{port} sync=true"
    with Pipeline.parse(text) as pipeline:
        found = run(pipeline)
        assert pipeline["out"].results["lost_datagrams"] > 0
    assert len(found) == 1
    assert "a datagram could not be sent: Connection refused; others like it are counted" in found[0]


def test_a_file_sent_too_fast_is_told(port: int, clip: Path) -> None:
    """A receiver would lose most of it."""
    with Pipeline.parse(f"filesrc location={clip} ! packetsink location=udp://127.0.0.1:{port}") as pipeline:
        assert any("set sync=true" in text for text in run(pipeline))


@pytest.mark.parametrize(
    ("location", "rule"),
    [
        (
            "srt://host?passphrase=hidden123",
            "the port is missing; write srt://HOST:PORT",
        ),
        ("rtsp://me:hidden123@host/live", "rtspclientsink pushes to an RTSP server"),
        (
            "rtmp://me:hidden123@host/live",
            "location must be a file, - .the standard output., udp://HOST:PORT",
        ),
        ("udp://host", "the host or the port is missing"),
        ("udp://host:5000?ttl=0", "ttl= from 1 to 255 only"),
    ],
)
@pytest.mark.parametrize("sink", ["videotestsrc ! videofilesink", "filesrc location=x.ts ! packetsink"])
def test_what_cannot_be_a_location(sink: str, location: str, rule: str) -> None:
    """The error names the rule and the remedy, and no password."""
    with pytest.raises(DescriptionError, match=rule) as caught:
        Pipeline.parse(f"{sink} location={location}")
    assert "hidden" not in str(caught.value)


@pytest.mark.parametrize(
    ("location", "unknown"),
    [
        ("-", "max-size-time"),
        ("udp://127.0.0.1:5000", "max-files"),
        ("live.m3u8", "max-age"),
        ("live.m3u8", "arrivals"),
    ],
)
def test_what_is_for_files_is_refused_elsewhere(location: str, unknown: str) -> None:
    """A property that would do nothing is an error."""
    with pytest.raises(DescriptionError, match=f"{unknown} must not be set: it is for files"):
        Pipeline.parse(f"filesrc location=x.ts ! packetsink location={location} {unknown}=1")


def test_an_unknown_host_is_told_before_playing() -> None:
    """As far as it is known."""
    pipeline = Pipeline.parse("videotestsrc ! videofilesink location=udp://no-such-host.invalid:5000")
    with pytest.raises(ElementFailure, match=r"'no-such-host\.invalid' is not known here$"):
        pipeline.ready()
    pipeline.stop()


def test_datagram_targets() -> None:
    """Host and port, interface, hops."""
    assert target_address("udp://[ff15::1]:5000?localaddr=::1&ttl=3") == UdpAddress("ff15::1", 5000, "::1", 3)
    assert target_address("udp://@host:5000") == UdpAddress("host", 5000, "", 1)


def test_a_playlist_holds_every_packet(clip: Path, tmp_path: Path) -> None:
    """Segments begin with keyframes and are as long as asked; a second run continues the list."""
    playlist = tmp_path / "new folder" / "live.m3u8"
    text = WITH_TELEMETRY.format(clip, f'location="{playlist}" max-size-time=800000000')
    Pipeline.parse(text).run(timeout_s=20)
    assert count_packets(playlist) == {"video": 100, "data": 100}
    names = sorted(path.name for path in playlist.parent.iterdir())
    assert names == [f"live-{number:05d}.ts" for number in range(5)] + ["live.m3u8"]
    Pipeline.parse(text).run(timeout_s=20)
    lines = playlist.read_text().splitlines()
    assert [line for line in lines if line.startswith("live-")] == [f"live-{n:05d}.ts" for n in range(10)]
    assert "#EXT-X-DISCONTINUITY" in lines


@pytest.mark.parametrize("sink", ["videofilesink", "encode gop=25 ! packetsink max-size-time=2000000000"])
def test_old_segments_of_a_playlist_go(tmp_path: Path, sink: str) -> None:
    """`max-files` of them are listed; FFmpeg keeps one more for who is reading it."""
    playlist = tmp_path / "live.m3u8"
    text = (
        f"videotestsrc num-buffers=300 ! video/x-raw,framerate=25/1 ! {sink} max-files=3 location={playlist}"
    )
    Pipeline.parse(text).run(timeout_s=30)
    listed = [line for line in playlist.read_text().splitlines() if line.startswith("live-")]
    assert listed == ["live-00003.ts", "live-00004.ts", "live-00005.ts"]
    assert len(list(tmp_path.glob("*.ts"))) == 4


def test_livesrc_plays_a_growing_playlist(tmp_path: Path, serve_folder: str) -> None:
    """Over HTTP, from its second segment on."""
    playlist = tmp_path / "live.m3u8"
    source = "videotestsrc is-live=true ! video/x-raw,width=64,height=48,framerate=25/1"
    with Pipeline.parse(f"{source} ! videofilesink max-files=4 location={playlist}") as sender:
        sender.play()
        deadline = time.monotonic() + patience(30)
        while not (playlist.exists() and "live-00001.ts" in playlist.read_text()):
            assert time.monotonic() < deadline
            time.sleep(0.1)
        uri = f"{serve_folder}/live.m3u8"
        with Pipeline.parse(f"livesrc uri={uri} timeout-s=20 ! decode ! appsink name=out") as receiver:
            receiver.play()
            frames = list(islice(receiver["out"], 110))
    assert not any(frame.flags & FrameFlags.CORRUPT for frame in frames)


def test_a_full_disk_is_told_though_ffmpeg_hides_it(tmp_path: Path) -> None:
    """The damaged segment does not appear."""
    source = "videotestsrc pattern=snow num-buffers=100 ! video/x-raw,width=64,height=48"
    text = f"{source} ! videofilesink location={tmp_path / 'live.m3u8'}"
    limit = (20_000, 20_000)
    done = subprocess.run(
        [*COMMAND, text],
        capture_output=True, text=True, timeout=patience(60), check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit),
    )  # fmt: skip
    assert done.returncode == 1
    assert "live.m3u8: cannot be written: File too large" in done.stderr
    assert not (tmp_path / "live-00000.ts").exists()
