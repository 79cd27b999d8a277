import gc
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from streamkit import DescriptionError, ElementFailure, Frame, Pipeline, raw_video_caps
from streamkit.testing import Harness
from streamkit_media.encoding.encoder import Encoder


def grey_frame(width: int = 64, height: int = 48, index: int = 0) -> Frame:
    """A grey frame at 25/s."""
    return Frame(
        np.full((height, width), 90, np.uint8), raw_video_caps("GRAY8", width, height), pts=index * 40_000_000
    )


def count_of(path: Path) -> int:
    """Frames in a file."""
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


def test_a_video_survives_the_round(tmp_path: Path, small_video: Path) -> None:
    """Filesrc ! decode ! videofilesink gives the same frames at the same times."""
    path = tmp_path / "out.mp4"
    Pipeline.parse(f'filesrc location="{small_video}" ! decode ! videofilesink crf=10 location="{path}"').run(
        20
    )
    with av.open(str(small_video)) as before, av.open(str(path)) as after:
        for old, new in zip(before.decode(video=0), after.decode(video=0), strict=True):
            assert new.time == pytest.approx(old.time, abs=1e-4)
            assert np.abs(old.to_ndarray().astype(int) - new.to_ndarray()).mean() < 3


def test_a_stopped_sink_holds_no_encoder(tmp_path: Path) -> None:
    """A program that runs hundreds of pipelines would keep tens of megabytes of each."""
    pipeline = Pipeline.parse(f'videotestsrc num-buffers=3 ! videofilesink location="{tmp_path}/out.mp4"')
    pipeline.run(20)
    gc.collect()
    assert not [item for item in gc.get_objects() if isinstance(item, Encoder)]


@pytest.mark.parametrize("ending", ["mp4", "mov"])
def test_a_file_has_the_length_and_rate_of_its_frames(tmp_path: Path, ending: str) -> None:
    """Although frames are reordered: OpenCV computes the rate from the length, and would report 26.1."""
    path = tmp_path / f"out.{ending}"
    caps = "video/x-raw, format=GRAY8, width=64, height=48, framerate=25/1"
    Pipeline.parse(f'videotestsrc num-buffers=50 ! {caps} ! videofilesink location="{path}"').run(20)
    with av.open(str(path)) as container:
        (stream,) = container.streams.video
        packets = [packet for packet in container.demux(stream) if packet.size]
        assert [packet.pts for packet in packets] != sorted(packet.pts or 0 for packet in packets)
        assert stream.duration is not None
        assert stream.time_base is not None
        assert float(stream.duration * stream.time_base) == pytest.approx(2.0)
    opened = cv2.VideoCapture(str(path))
    assert opened.get(cv2.CAP_PROP_FPS) == pytest.approx(25.0)
    assert opened.get(cv2.CAP_PROP_FRAME_COUNT) == 50


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv"])
def test_every_frame_of_a_moving_camera_is_shown(tmp_path: Path, ending: str) -> None:
    """Also where the encoder codes frames after the last one that is shown: players keep to edit lists."""
    noise = np.random.default_rng(0).integers(0, 256, (200, 400), np.uint8)
    ground = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2), np.uint8)
    caps = "video/x-raw,format=GRAY8,width=160,height=120,framerate=25/1"
    for count in range(25, 30):
        path = tmp_path / f"{count}.{ending}"
        with Pipeline.parse(f"appsrc name=in caps={caps} ! videofilesink location={path}") as pipeline:
            pipeline.play()
            for at in range(count):
                pipeline["in"].push(
                    np.ascontiguousarray(ground[at // 2 : at // 2 + 120, 2 * at : 2 * at + 160])
                )
            pipeline["in"].end()
            pipeline.wait(60)
        with av.open(str(path)) as container:
            times = [float(frame.pts * frame.time_base) for frame in container.decode(video=0)]
        assert times == pytest.approx([at / 25 for at in range(count)], abs=1e-3)


def test_an_interrupted_file_plays(tmp_path: Path) -> None:
    """A pipeline stopped without EOS leaves a file that plays up to there."""
    path = tmp_path / "out.mp4"
    with Harness("videofilesink", location=str(path)) as harness:
        for index in range(7):
            harness.push(grey_frame(index=index))
    assert count_of(path) == 7


@pytest.mark.parametrize("suffix", [".mp4", ".mov"])
def test_a_growing_file_has_the_times_of_its_frames(tmp_path: Path, suffix: str) -> None:
    """From the first fragment on, as a killed process leaves it; every frame but the last few decodes.

    All are later by the two frames that are reordered.
    """
    path, grown = tmp_path / f"out{suffix}", tmp_path / f"grown{suffix}"
    with Harness("videofilesink", location=str(path)) as harness:
        for index in range(80):
            harness.push(grey_frame(index=index))
        shutil.copy(path, grown)
    with av.open(str(grown)) as container:
        packets = sum(1 for packet in container.demux(video=0) if packet.size)
    with av.open(str(grown)) as container:
        times = [frame.time for frame in container.decode(video=0)]
    assert len(times) == packets > 50
    assert times[:50] == pytest.approx([(2 + index) / 25 for index in range(50)], abs=1e-4)


def test_a_new_size_is_refused_and_the_file_plays(tmp_path: Path) -> None:
    """A size that changes is an error with a remedy; what came before is kept."""
    path = tmp_path / "out.mp4"
    with Harness("videofilesink", location=str(path)) as harness:
        harness.push(grey_frame())
        with pytest.raises(
            ElementFailure,
            match=r"began with GRAY8 64 x 48 and now GRAY8 32 x 48 comes; give the name a number, out-%05d",
        ):
            harness.push(grey_frame(width=32, index=1))
    assert count_of(path) == 1


def test_a_numbered_name_has_a_file_for_each_size(tmp_path: Path) -> None:
    """A camera that comes back at another size is recorded on; each file is whole and begins at 0 s."""
    with Harness("videofilesink", location=str(tmp_path / "out-%03d.mp4")) as harness:
        for index in range(30):
            harness.push(grey_frame(width=64 if index < 10 or index >= 20 else 32, index=index))
        harness.drain()
        assert harness.element.results["files"] == 3
    for number, width in enumerate((64, 32, 64)):
        path = tmp_path / f"out-{number:03d}.mp4"
        assert count_of(path) == 10
        with av.open(str(path)) as container:
            assert container.streams.video[0].width == width
            assert next(container.decode(video=0)).time == pytest.approx(0.0, abs=1e-3)


def test_a_next_file_that_cannot_be_made_leaves_the_first_whole(tmp_path: Path) -> None:
    """Its name was taken by another program meanwhile."""
    with Harness("videofilesink", location=str(tmp_path / "out-%03d.mp4"), if_exists="fail") as harness:
        harness.push(grey_frame())
        (tmp_path / "out-001.mp4").write_bytes(b"another")
        with pytest.raises(ElementFailure, match="exists already"):
            harness.push(grey_frame(width=32, index=1))
    assert count_of(tmp_path / "out-000.mp4") == 1
    assert (tmp_path / "out-001.mp4").read_bytes() == b"another"


def test_odd_sizes_are_written(tmp_path: Path) -> None:
    """A frame of odd size is recorded."""
    path = tmp_path / "out.mp4"
    with Harness("videofilesink", location=str(path)) as harness:
        harness.push(grey_frame(33, 21))
        harness.drain()
    assert count_of(path) == 1


@pytest.mark.parametrize(
    ("properties", "rule"),
    [
        ("", "location must be set; write for example location=out.mp4"),
        ("location=/etc/passwd/out.mp4", "out.mp4: cannot be written: Not a directory"),
    ],
)
def test_bad_locations_fail_before_playing(properties: str, rule: str) -> None:
    """A file that cannot be written is known when the element starts."""
    pipeline = Pipeline.parse(f"fakesrc num-buffers=1 ! videofilesink {properties}")
    with pytest.raises(ElementFailure, match=rule):
        pipeline.ready()
    pipeline.stop()


def test_a_name_without_container_is_refused_at_once(tmp_path: Path) -> None:
    """A name of an unknown container is refused at once; the error lists the known ones."""
    with pytest.raises(DescriptionError, match=r"must end in \.mp4, \.mov, .*, it ends in '\.xyz'"):
        Pipeline.parse(f"videotestsrc ! videofilesink location={tmp_path}/out.xyz")


@pytest.mark.parametrize(
    ("pixels", "got"),
    [(np.zeros((10, 64), np.uint8), r"uint8\[10, 64\]"), (np.zeros((48, 64)), r"float64\[48, 64\]")],
)
def test_pixels_that_are_not_what_the_caps_say_are_refused(
    tmp_path: Path, pixels: NDArray[Any], got: str
) -> None:
    """An element upstream that hands on another shape or type than it promised makes no false video."""
    frame = grey_frame().replace(data=pixels)
    with (
        Harness("videofilesink", location=str(tmp_path / "out.mp4")) as harness,
        pytest.raises(ElementFailure, match=rf"GRAY8 of 64 x 48 must be uint8\[48, 64\], got {got};"),
    ):
        harness.push(frame)


LAUNCH = "import sys; from streamkit.cli.main import main; sys.argv[1:] = ['launch', sys.argv[1]]; main()"


@pytest.mark.parametrize("between", ["", "! queue max-size-buffers=100"])
def test_a_full_disk_is_an_error_and_no_crash(tmp_path: Path, between: str) -> None:
    """A full disk at the first bytes ends the pipeline with one error."""
    path = tmp_path / "out.mp4"
    path.symlink_to("/dev/full")
    text = (
        f"videotestsrc num-buffers=80 ! video/x-raw,format=I420,width=64,height=48 {between} "
        f"! videofilesink preset=ultrafast location={path}"
    )
    command = [sys.executable, "-c", LAUNCH, text]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 1, done.stderr
    assert "cannot be written: No space left on device; free some space" in done.stderr
    assert "no frame came" not in done.stderr


def test_a_frame_that_lasts_seven_hours_is_written(tmp_path: Path) -> None:
    """A frame rate of 1/25600, whose durations MP4 cannot hold, does not crash the process."""
    path = tmp_path / "slow.mp4"
    caps = "video/x-raw,format=GRAY8,width=64,height=48,framerate=1/25600"
    text = f"videotestsrc num-buffers=1 ! {caps} ! videofilesink location={path}"
    script = f"from streamkit import Pipeline; Pipeline.parse({text!r}).run(timeout_s=20)"
    subprocess.run([sys.executable, "-c", script], check=True, timeout=40)
    assert count_of(path) == 1
