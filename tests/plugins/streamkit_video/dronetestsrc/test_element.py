"""Tests of dronetestsrc in pipelines."""

import time
from pathlib import Path

import numpy as np
import pytest

from streamkit import Pipeline, StreamkitError
from streamkit_video import TrueRegistration, TrueTargets
from tests.frames import frames_of

SMALL = "video/x-raw, width=160, height=120"


def test_its_default_is_720p_grey() -> None:
    """1280x720, GRAY8, 25 frames a second, with truth, numbered and timed."""
    frames = frames_of("dronetestsrc num-buffers=2")
    caps = frames[0].caps
    assert (caps["format"], caps["width"], caps["height"], caps["framerate"]) == ("GRAY8", 1280, 720, 25)
    assert [frame.pts for frame in frames] == [0, 40_000_000]
    assert [frame.duration for frame in frames] == [40_000_000, 40_000_000]
    assert [frame.seq for frame in frames] == [0, 1]
    assert frames[1].data.shape == (720, 1280)
    assert frames[1].data.dtype == np.uint8
    registration, targets = frames[1].get(TrueRegistration), frames[1].get(TrueTargets)
    assert registration is not None
    assert registration.to_previous.shape == (3, 3)
    assert targets is not None
    assert len(targets) >= 8


@pytest.mark.parametrize(
    ("name", "shape"), [("GRAY8", (120, 160)), ("I420", (180, 160)), ("BGR", (120, 160, 3))]
)
def test_formats(name: str, shape: tuple[int, ...]) -> None:
    """Each format has its layout and shows the same image."""
    frame = frames_of(f"dronetestsrc num-buffers=1 noise=0 ! {SMALL}, format={name}")[0]
    assert frame.data.shape == shape
    assert 60 < frame.data[:120].mean() < 170


def test_any_size_and_rate() -> None:
    """Odd sizes and odd rates are fine for GRAY8; times follow the rate without drift."""
    frames = frames_of("dronetestsrc num-buffers=4 ! video/x-raw, width=77, height=53, framerate=30000/1001")
    assert frames[3].data.shape == (53, 77)
    assert frames[3].pts == 3 * 1001 * 1_000_000_000 // 30000


def test_an_odd_size_of_i420_is_refused() -> None:
    """The error names the element, the rule, the size and the remedy."""
    with pytest.raises(
        StreamkitError, match=r"dronetestsrc0: I420 needs an even width and height, got 161x120"
    ):
        frames_of("dronetestsrc ! video/x-raw, format=I420, width=161, height=120")


def test_the_same_description_gives_the_same_frames() -> None:
    """Two runs agree bit for bit; another seed does not."""
    one, two, other = (frames_of(f"dronetestsrc num-buffers=5 seed={seed} ! {SMALL}") for seed in (3, 3, 4))
    assert all(np.array_equal(left.data, right.data) for left, right in zip(one, two, strict=True))
    assert not np.array_equal(one[4].data, other[4].data)


def test_it_starts_again_from_the_first_frame() -> None:
    """A pipeline played twice shows the same flight twice."""
    runs = []
    pipeline = Pipeline.parse(f"dronetestsrc num-buffers=2 ! {SMALL} ! appsink name=out")
    for _ in range(2):
        with pipeline:
            pipeline.play()
            runs.append(list(pipeline["out"]))
    assert np.array_equal(runs[0][1].data, runs[1][1].data)


def test_a_missing_image_names_the_element(tmp_path: Path) -> None:
    """`location` that is not there fails at start, with the path."""
    with pytest.raises(StreamkitError, match=r"dronetestsrc0: location: .*gone\.jpg"):
        frames_of(f"dronetestsrc location={tmp_path}/gone.jpg")


def test_a_live_source_keeps_real_time() -> None:
    """The fourth frame at 20 a second comes no earlier than three intervals after the start."""
    began_ns = time.monotonic_ns()
    frames = frames_of(f"dronetestsrc num-buffers=4 is-live=true ! {SMALL}, framerate=20/1")
    assert frames[-1].arrival_ns - began_ns >= 150_000_000


def test_an_endless_live_source_stops_at_once() -> None:
    """Stopping does not wait for the next frame of a slow camera."""
    with Pipeline.parse(
        f"dronetestsrc is-live=true ! {SMALL}, framerate=1/50 ! appsink name=out"
    ) as pipeline:
        pipeline.play()
        assert pipeline["out"].pull(timeout_s=10.0) is not None
