"""livesrc with a camera of this machine: FFmpeg reads a file that answers the requests of Video4Linux."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from streamkit_media.live.camerainput import camera_device, camera_options
from tests.slowness import patience

CAMERA = Path(__file__).with_name("fake_camera.c")
# Plays to the end, which may be an error; prints what has come, how it ended, and how long stopping took.
PROGRAM = """
import json, sys, time
from itertools import islice
from streamkit import Pipeline, StreamkitError
from tests.waiting import next_state
with Pipeline.parse(sys.argv[1]) as pipeline:
    pipeline.play()
    frames, error = [], ""
    try:
        frames = list(islice(pipeline["out"], int(sys.argv[2])))
        if sys.argv[3:]:
            error = str(next_state(pipeline, sys.argv[3]).fields["reason"])
    except StreamkitError as failure:
        error = str(failure)
    began = time.monotonic()
stop_s = time.monotonic() - began
rows = [(*frame.data.shape, frame.pts, frame.capture.origin) for frame in frames]
print(json.dumps([rows, error, stop_s]))
"""


@pytest.fixture(scope="session")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library to preload."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler: install gcc")
    library = tmp_path_factory.mktemp("camera") / "camera.so"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-o", str(library), str(CAMERA), "-ldl"], check=True, timeout=60
    )
    return library


def play(shim: Path, folder: Path, source: str, *arguments: str, **camera: str) -> tuple[list, str, float]:
    """Plays a camera in a process of its own; see `PROGRAM`."""
    device = folder / "camera"
    device.touch()
    text = f"livesrc uri=v4l2://{device}{source} ! decode ! appsink name=out max-buffers=0"
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, text, *arguments],
        env={**os.environ, "LD_PRELOAD": str(shim), "FAKE_CAMERA": str(device), **camera},
        capture_output=True, text=True, timeout=patience(40), check=True,
    )  # fmt: skip
    return json.loads(done.stdout)


def test_a_camera_is_played(shim: Path, tmp_path: Path) -> None:
    """Its pictures come with their size, ascending times, and the time of arrival."""
    rows, error, _ = play(shim, tmp_path, "?video_size=64x48&framerate=25", "20")
    times = [row[2] for row in rows]
    assert (len(rows), error) == (20, "")
    assert {(*row[:2], row[3]) for row in rows} == {(48, 64, "arrival")}
    assert times == sorted(set(times))


def test_a_camera_that_gives_no_more_is_stalled(shim: Path, tmp_path: Path) -> None:
    """A wait that FFmpeg cannot end is ended from outside, so that the pipeline stops at once."""
    _, reason, stop_s = play(shim, tmp_path, " timeout-s=0.5", "1", "stalled", FAKE_PICTURES="5")
    assert "silent for 0.5 s" in reason
    assert stop_s < patience(2)


def test_a_camera_that_gives_nothing_ends_the_pipeline(shim: Path, tmp_path: Path) -> None:
    """FFmpeg waits for the first picture while it opens the device: that wait is ended, too."""
    rows, error, stop_s = play(shim, tmp_path, " timeout-s=0.5", "1", FAKE_PICTURES="0")
    assert not rows
    assert "silent for 0.5 s" in error
    assert stop_s < patience(2)


def test_a_camera_that_is_unplugged_is_tried_again(shim: Path, tmp_path: Path) -> None:
    """The reason names the cable."""
    _, reason, _ = play(shim, tmp_path, "", "1", "retrying", FAKE_PICTURES="5", FAKE_END="ENODEV")
    assert "No such device; check the cable of the camera" in reason


def test_pictures_outlive_the_camera(shim: Path, tmp_path: Path) -> None:
    """Packets of a closed device, whose memory is gone, are decoded: doctor does so with all it has seen."""
    device = tmp_path / "camera"
    device.touch()
    done = subprocess.run(
        [sys.executable, "-m", "streamkit", "doctor", f"v4l2://{device}", "--seconds", "1"],
        env={**os.environ, "LD_PRELOAD": str(shim), "FAKE_CAMERA": str(device)},
        capture_output=True, text=True, timeout=patience(40), check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "decoding" in done.stdout
    assert f"livesrc name=s uri=v4l2://{device} ! decode" in done.stdout


def test_a_file_is_no_camera(shim: Path, tmp_path: Path) -> None:
    """What does not answer ends the pipeline, with what to do."""
    _, error, _ = play(shim, tmp_path, "", "1", FAKE_CAMERA="none")
    assert "the camera gives no video: Inappropriate ioctl for device; this device is no camera" in error


@pytest.mark.parametrize(
    ("location", "device"),
    [
        ("0", "/dev/video0"),
        ("/dev/video12", "/dev/video12"),
        ("v4l2:///dev/video1?framerate=30", "/dev/video1"),
        ("flight.mp4", ""),
        ("udp://@:5000", ""),
        ("v4l2://drone/dev/video0", ""),
    ],
)
def test_a_camera_is_known_by_its_location(location: str, device: str) -> None:
    """By its number, its device, or GStreamer's URL."""
    assert camera_device(location) == device


def test_what_a_camera_is_asked_for_stands_in_the_url() -> None:
    """A key that FFmpeg's device does not have here is refused."""
    assert camera_options("v4l2:///dev/video0?video_size=64x48") == {"video_size": "64x48"}
    with pytest.raises(ValueError, match="got fps"):
        camera_options("v4l2:///dev/video0?fps=30")
