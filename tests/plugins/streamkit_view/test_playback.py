"""The pipeline of a file or camera: what it prints while it starts, and why it failed."""

import contextlib
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import av
import pytest
from av.video.frame import VideoFrame

from streamkit import Pipeline
from streamkit_view.locations import pipeline_for, size_conflict, unplayable
from streamkit_view.playback import PlayedPipeline
from tests.slowness import patience

SCRIPT = """
import sys, time
print("warning: ground: loops are being compiled", file=sys.stderr, flush=True)
sys.stdin.close()
time.sleep({seconds})
print("error: rtsp://user:secret@drone/live cannot be opened", file=sys.stderr)
sys.exit("error: threads did not end")
"""


def playback(seconds: float) -> PlayedPipeline:
    """A pipeline that compiles, and fails after a time."""
    script = SCRIPT.format(seconds=seconds)
    return PlayedPipeline("rtsp://user:secret@drone/live", "view/1", command=(sys.executable, "-c", script))


def test_the_element_that_compiles_is_named(
    wait_for: Callable[..., Any], capfd: pytest.CaptureFixture[str]
) -> None:
    """To the page, and in the terminal; the end of the playback ends the process."""
    found = playback(600)
    assert found.progress == "The pipeline is starting."
    try:
        found.start()
        wait_for(lambda: found.progress == "The pipeline is starting. ground: loops are being compiled")
        assert found.failure == ""
        assert found.printed.text == "ground: loops are being compiled"
        assert 0 < found.printed.at_s <= time.monotonic()
    finally:
        found.close()
    assert "warning: ground: loops are being compiled" in capfd.readouterr().err


def test_a_failure_is_its_first_error_without_secrets(wait_for: Callable[..., Any]) -> None:
    """The password of the camera is masked; what the pipeline prints while it stops does not replace it."""
    found = playback(0)
    try:
        found.start()
        wait_for(lambda: found.progress.endswith("error: threads did not end"))
        assert "cannot be opened" in found.failure
        assert "secret" not in found.failure
    finally:
        found.close()


@pytest.fixture
def mpeg2_feed(tmp_path: Path) -> Iterator[str]:
    """The URL of a server that sends MPEG-2 video to one client."""
    path = tmp_path / "feed.ts"
    with av.open(str(path), "w") as output:
        stream = output.add_stream("mpeg2video", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in range(50):
            frame = VideoFrame(64, 48, "yuv420p")
            frame.pts = number
            output.mux(stream.encode(frame))
        output.mux(stream.encode())

    def serve() -> None:
        with contextlib.suppress(OSError):
            client, _ = server.accept()
            with client:
                client.sendall(path.read_bytes())
                client.recv(1)  # until it leaves

    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(patience(40))
        thread = threading.Thread(target=serve)
        thread.start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
        thread.join(patience(40))


def test_a_codec_that_browsers_do_not_have_names_the_option(
    wait_for: Callable[..., Any], mpeg2_feed: str
) -> None:
    """Of a live feed the codec is known only when it is connected; encoded here, it is played."""
    found = PlayedPipeline(mpeg2_feed, "view/1")
    try:
        found.start()
        wait_for(lambda: found.failure.endswith("; streamkit view --encode encodes the video for browsers"))
    finally:
        found.close()
    assert pipeline_for(mpeg2_feed, encodes=True) == ("encoded_camera.pipe", "livesrc uri")


def test_a_file_that_cannot_be_played_is_known_before(tmp_path: Path, streamkit_data: Path) -> None:
    """With the reason; a URL is tried when the page is opened."""
    text = tmp_path / "notes.mp4"
    text.write_text("no video")
    assert "no media that FFmpeg can read" in unplayable(str(text))
    assert unplayable(str(streamkit_data / "video" / "fixed_camera_cars.mp4")) == ""
    assert unplayable("rtsp://nowhere.invalid/live") == ""


def test_a_codec_that_browsers_do_not_have_is_shown_in_images(streamkit_data: Path) -> None:
    """Another one than H.264 and H.265; as the video of a finished run it is refused, with the remedy."""
    divx = streamkit_data / "video" / "pets09_s2l1.avi"
    photograph = streamkit_data / "mosaic" / "aerial_cc0.jpg"
    for file in (divx, photograph):
        assert pipeline_for(str(file)) == ("images.pipe", "filesrc location")
        assert unplayable(str(file)) == ""
    assert "browsers decode no video/x-" in unplayable(str(divx), with_records=True)


def test_records_of_turned_frames_are_those_of_their_video(tmp_path: Path, turned_video: Path) -> None:
    """The page turns the packets of 64 x 48 px as `decode` turns the frames."""
    records = tmp_path / "tracks.jsonl"
    tracks = f"decode ! particletrack window=10,10,20,20 ! tracksink location={records}"
    Pipeline.parse(f"filesrc location={turned_video} ! {tracks}").run(timeout_s=60)
    assert '"width":48,"height":64' in records.read_text()
    assert size_conflict(str(records), str(turned_video)) == ""
    assert unplayable(str(turned_video), with_records=True) == ""


def test_the_video_of_another_run_is_refused(tmp_path: Path) -> None:
    """Records name the size of their frames; where they do not, any video is taken."""
    video, records = tmp_path / "flight.mp4", tmp_path / "tracks.jsonl"
    Pipeline.parse(f"videotestsrc num-buffers=5 ! videofilesink location={video}").run(timeout_s=60)
    line = '{"schema":"streamkit.tracks/1","source":"a","seq":0,"epoch":0,%s"tracks":[],"dropped":0}\n'
    for size, refused in (("640,", True), ("320,", False), ("", False)):
        records.write_text(line % (size and f'"width":{size}"height":240,'))
        assert bool(text := size_conflict(str(records), str(video))) is refused
        assert not refused or "of frames of 640 x 240 px, the video has 320 x 240; give their own" in text
    records.write_text("")
    assert size_conflict(str(records), str(video)) == ""


@pytest.mark.parametrize(
    ("location", "pipeline", "source"),
    [
        ("flight.mp4", "file.pipe", "filesrc location"),
        ("https://host/flight.mp4", "file.pipe", "filesrc location"),
        ("https://host/live.m3u8?x=1", "camera.pipe", "livesrc uri"),
        ("udp://@239.1.2.3:5000", "camera.pipe", "livesrc uri"),
        ("rtsps://drone/live", "camera.pipe", "rtspsrc location"),
        ("0", "encoded_camera.pipe", "livesrc uri"),
        ("v4l2:///dev/video0?framerate=30", "encoded_camera.pipe", "livesrc uri"),
        ("http://camera/video.mjpg?fps=5", "encoded_camera.pipe", "livesrc uri"),
        ("tracks.jsonl", "run.pipe", "tracksrc location"),
    ],
)
def test_the_pipeline_fits_the_location(location: str, pipeline: str, source: str) -> None:
    """Live URLs are received with reconnects, cameras of images are encoded, files take real time."""
    assert pipeline_for(location) == (pipeline, source)
