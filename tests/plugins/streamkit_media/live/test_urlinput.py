"""livesrc over TCP, RTMP and HTTP."""

import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from itertools import islice, pairwise
from pathlib import Path

import av
import pytest

from streamkit import ElementFailure, FrameFlags, MessageKind, Pipeline
from tests.plugins.streamkit_media.web_server import Handler

Start = Callable[..., subprocess.Popen[bytes]]
QUICK = "retry-delay-s=0.1 max-retry-delay-s=0.3 max-retries=200"


@pytest.fixture
def silent() -> Iterator[int]:
    """The port of a server that takes connections and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server.getsockname()[1]


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:{port}", "rtmp://127.0.0.1:{port}/live/a"])
def test_a_sender_that_comes_back_is_a_new_epoch(start_ffmpeg: Start, port: int, address: str) -> None:
    """A connection that breaks is made again; times go on, the gap is marked."""
    url = address.format(port=port)
    sender = start_ffmpeg(url)
    source = f"livesrc uri={url} {QUICK}"
    with Pipeline.parse(f"{source} ! decode ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        before = list(islice(frames, 20))
        sender.kill()
        sender.wait(10)
        start_ffmpeg(url)
        after = next(frame for frame in frames if frame.epoch == 1)
    assert all(a.pts < b.pts for a, b in pairwise(before))
    assert after.flags & FrameFlags.DISCONTINUITY
    assert after.pts > before[-1].pts


def test_telemetry_comes_over_tcp(start_ffmpeg: Start, port: int) -> None:
    """The pads of telemetry are those of UDP."""
    start_ffmpeg(f"tcp://127.0.0.1:{port}")
    text = f"livesrc name=s uri=tcp://127.0.0.1:{port} {QUICK}  s.src ! fakesink  s.klv ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert len(list(islice(pipeline["out"], 10))) == 10


def test_a_playlist_is_played_in_real_time(clip: Path, tmp_path: Path, serve_folder: str) -> None:
    """Segments come in bursts and leave as they were recorded; the end of the list is that of the stream."""
    with (
        av.open(str(clip)) as source,
        av.open(
            str(tmp_path / "live.m3u8"), "w", format="hls", options={"hls_time": "1", "hls_list_size": "0"}
        ) as output,
    ):
        video = source.streams.video[0]
        copy = output.add_stream_from_template(video)
        for packet in source.demux(video):
            if packet.dts is not None:
                packet.stream = copy
                output.mux(packet)
    with Pipeline.parse(
        f"livesrc uri={serve_folder}/live.m3u8 ! decode ! appsink name=out max-buffers=0"
    ) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        ended = pipeline.wait(5)
    assert ended is not None
    assert ended.kind is MessageKind.EOS
    assert len(frames) == 100
    played_s = (frames[-1].arrival_ns - frames[0].arrival_ns) / 1e9
    assert played_s > 0.9 * (frames[-1].pts - frames[0].pts) / 1e9


def test_jpeg_over_http_has_times_of_arrival(
    serve_folder: str, make_video: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cameras that send pictures without times are live video too."""
    path = make_video("one.jpg", count=1, codec="mjpeg", pixel_format="yuvj420p")
    monkeypatch.setattr(Handler, "picture", path.read_bytes())
    with Pipeline.parse(
        f"livesrc uri={serve_folder}/jpeg latency=5000 ! decode ! appsink name=out"
    ) as pipeline:
        pipeline.play()
        frames = list(islice(pipeline["out"], 25))
    assert all(a.pts < b.pts for a, b in pairwise(frames))
    assert frames[-1].pts - frames[0].pts > 0.3e9


@pytest.mark.parametrize("scheme", ["tcp", "rtmp", "http"])
def test_a_closed_port_is_reported(port: int, scheme: str) -> None:
    """A refused first connection ends the pipeline with its reason."""
    with pytest.raises(ElementFailure, match="Connection refused"):
        Pipeline.parse(f"livesrc uri={scheme}://me:hunter2@127.0.0.1:{port}/a ! fakesink").run(timeout_s=20)


@pytest.mark.parametrize("scheme", ["tcp", "rtmp", "http"])
def test_a_silent_server_is_left_at_once(silent: int, scheme: str) -> None:
    """A connection that waits for a minute is cut."""
    with Pipeline.parse(f"livesrc uri={scheme}://127.0.0.1:{silent}/a timeout-s=60 ! fakesink") as pipeline:
        pipeline.play()
        assert pipeline.wait(0.3) is None
        began = time.monotonic()
    assert time.monotonic() - began < 5
    assert not [thread.name for thread in threading.enumerate() if thread.name.startswith("reader")]


@pytest.mark.parametrize("scheme", ["tcp", "rtmp", "http"])
def test_a_silent_server_is_noticed(silent: int, scheme: str) -> None:
    """Silence ends in one error, without the password."""
    text = f"livesrc uri={scheme}://me:hunter2@127.0.0.1:{silent}/a timeout-s=0.5 ! fakesink"
    with pytest.raises(ElementFailure, match=r"no video within 0\.5 s|silent for 0\.5 s") as caught:
        Pipeline.parse(text).run(timeout_s=20)
    assert "hunter2" not in str(caught.value)


def test_a_server_cannot_have_files_opened(serve_folder: str, tmp_path: Path, clip: Path) -> None:
    """A playlist that names files of this machine is not followed."""
    (tmp_path / "bad.m3u8").write_text(
        f"#EXTM3U\n#EXT-X-TARGETDURATION:4\n#EXTINF:4,\nfile://{clip}\n#EXT-X-ENDLIST\n"
    )
    with pytest.raises(ElementFailure):
        Pipeline.parse(f"livesrc uri={serve_folder}/bad.m3u8 timeout-s=2 ! fakesink").run(timeout_s=20)
