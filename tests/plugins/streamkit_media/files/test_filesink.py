from pathlib import Path

import numpy as np
import pytest

from streamkit import Caps, DescriptionError, ElementFailure, Frame, Pipeline, raw_video_caps
from streamkit.output.names import TRACK_SUFFIXES
from streamkit.testing import Harness


def written(path: Path, *frames: Frame) -> bytes:
    """What filesink makes of these frames."""
    with Harness("filesink", location=str(path)) as harness:
        for frame in frames:
            harness.push(frame)
        harness.drain()
        return path.read_bytes()


@pytest.mark.parametrize("caps", ["text/x-raw", "application/json", "application/x-tracks"])
def test_text_is_written_in_lines(tmp_path: Path, caps: str) -> None:
    """A line gets its newline where it has none; str is written in UTF-8."""
    frames = [Frame(data, Caps(caps)) for data in ("grüße", b"two\n", b"", b"four")]
    assert written(tmp_path / "lines", *frames) == "grüße\ntwo\n\nfour\n".encode()


def test_other_bytes_are_written_as_they_are(tmp_path: Path) -> None:
    """Packets are neither parted nor padded."""
    frames = [Frame(data, Caps("video/x-h264")) for data in (b"\0\0\1", bytearray(b"ab"), memoryview(b"c"))]
    assert written(tmp_path / "raw", *frames) == b"\0\0\1abc"


def test_frames_are_written_without_line_padding(tmp_path: Path) -> None:
    """An array with padded lines is written row by row, its pixels alone."""
    padded = np.arange(48 * 80, dtype=np.uint32).astype(np.uint8).reshape(48, 80)[:, :64]
    data = written(tmp_path / "pixels", Frame(padded, raw_video_caps("GRAY8", 64, 48)))
    np.testing.assert_array_equal(np.frombuffer(data, np.uint8).reshape(48, 64), padded)


def test_frames_of_a_pipeline_are_in_the_file(tmp_path: Path, small_video: Path) -> None:
    """A whole video's frames end up in the file."""
    path = tmp_path / "frames.raw"
    Pipeline.parse(f'filesrc location="{small_video}" ! decode ! filesink location="{path}"').run(
        timeout_s=10
    )
    assert path.stat().st_size == 12 * 64 * 48


@pytest.mark.parametrize(
    ("location", "rule"),
    [
        ("", "location must be set; write for example location=out.bin"),
        ("/etc/passwd/out.bin", "/etc/passwd/out.bin: cannot be written: Not a directory; check that"),
        ("/", "/: cannot be written: Is a directory"),
    ],
)
def test_bad_locations_fail_before_playing(location: str, rule: str) -> None:
    """A file that cannot be written is known when the element starts."""
    pipeline = Pipeline.parse(f'fakesrc num-buffers=1 ! filesink location="{location}"')
    with pytest.raises(ElementFailure, match=rule):
        pipeline.ready()
    pipeline.stop()


def test_a_full_disk_is_reported() -> None:
    """A write that the system refuses is an error with the file's name."""
    rule = "/dev/full: cannot be written: No space left on device"
    with Harness("filesink", location="/dev/full") as harness, pytest.raises(ElementFailure, match=rule):
        harness.push(Frame(b"x" * 100, Caps("video/x-h264")))


@pytest.mark.parametrize(
    ("source", "sink"),
    [("filesrc location={}", "packetsink"), ("videotestsrc num-buffers=2", "videofilesink")],
)
def test_a_container_is_no_file_of_bytes(tmp_path: Path, small_video: Path, source: str, sink: str) -> None:
    """Players could not read it: the sink that makes such files is named, nothing is written."""
    path = tmp_path / "copy.mp4"
    with pytest.raises(ElementFailure, match=rf"no \.mp4 file; write {sink} location={path}"):
        Pipeline.parse(f"{source.format(small_video)} ! filesink location={path}").run(timeout_s=30)
    assert not path.exists()


@pytest.mark.parametrize("suffix", TRACK_SUFFIXES)
def test_track_records_are_no_bytes_of_video(tmp_path: Path, suffix: str) -> None:
    """Tracks travel with frames: the sink that writes them as records is named."""
    path = tmp_path / f"tracks{suffix}"
    with pytest.raises(ElementFailure, match=rf"no {suffix} file; write tracksink location={path}"):
        Pipeline.parse(f"videotestsrc num-buffers=2 ! filesink location={path}").run(timeout_s=30)
    assert not path.exists()


@pytest.mark.parametrize(
    ("sink", "remedy"),
    [
        ("filesink location={}/frame.png", "frame-%05d.jpg"),
        ("multifilesink location={}/frame-%d.png", "frame-%d.jpg"),
    ],
)
def test_pictures_are_no_bytes_of_pixels(tmp_path: Path, sink: str, remedy: str) -> None:
    """No viewer could open them: the sink that writes pictures is named, nothing is written."""
    text = f"videotestsrc num-buffers=2 ! {sink.format(tmp_path)}"
    with pytest.raises(ElementFailure, match=rf"no \.png file; write jpegsink location={tmp_path}/{remedy}"):
        Pipeline.parse(text).run(timeout_s=30)
    assert not list(tmp_path.iterdir())


def test_a_jpeg_is_not_written_under_the_name_of_another_format(tmp_path: Path) -> None:
    """Programs that go by the name could not read it."""
    with pytest.raises(DescriptionError, match=r"must end in \.jpg, \.jpeg, it ends in '\.png'"):
        Pipeline.parse(f"videotestsrc num-buffers=2 ! jpegsink location={tmp_path}/frame-%05d.png")


def test_a_container_is_refused_before_the_source_starts(tmp_path: Path) -> None:
    """Where any stream of the neighbour is video: a live source is not asked to connect."""
    with pytest.raises(ElementFailure, match=r"filesink0: .* write videofilesink"):
        Pipeline.parse(f"videotestsrc ! filesink location={tmp_path}/copy.mp4").ready()


def test_a_refused_stream_leaves_the_older_file(tmp_path: Path) -> None:
    """The encoder's last packets do not become the file that was refused."""
    path = tmp_path / "keep.mp4"
    path.write_bytes(b"older")
    with pytest.raises(ElementFailure, match=r"no \.mp4 file"):
        Pipeline.parse(f"videotestsrc num-buffers=30 ! encode ! filesink location={path}").run(20)
    assert path.read_bytes() == b"older"
