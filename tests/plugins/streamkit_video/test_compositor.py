"""compositor: videos side by side, paired by time."""

import threading

import numpy as np
import pytest

from streamkit import Caps, ElementFailure, Frame, Pipeline
from tests.waiting import wait_for

LIMIT_S = 30.0
MS = 1_000_000


def image(value: int, width: int = 4, height: int = 2) -> np.ndarray:
    """A BGR image of one value."""
    return np.full((height, width, 3), value, np.uint8)


def caps(width: int = 4, height: int = 2) -> Caps:
    """Caps of such an image."""
    return Caps(f"video/x-raw, format=BGR, width={width}, height={height}, framerate=25/1")


TWO = (
    "compositor name=c ! appsink name=out max-buffers=100  "
    "appsrc name=a max-buffers=0 ! c.  appsrc name=b max-buffers=0 ! c."
)


def compose(first: list[tuple[int, int]], second: list[tuple[int, int]]) -> list[tuple[int | None, int, int]]:
    """Time, left value and right value of each frame made of (time in ms, value) pairs of two inputs."""
    with Pipeline.parse(TWO) as pipeline:
        for name, given in (("a", first), ("b", second)):
            for time_ms, value in given:
                pipeline[name].push(Frame(image(value), caps(), pts=time_ms * MS))
            pipeline[name].end()
        pipeline.play()
        frames = list(pipeline["out"])
        message = pipeline.wait(LIMIT_S)
        assert message is not None
        assert message.error is None
    assert all(frame.data.shape == (2, 8, 3) for frame in frames)
    return [
        (frame.pts and frame.pts // MS, int(frame.data[0, 0, 0]), int(frame.data[0, -1, 0]))
        for frame in frames
    ]


def test_each_frame_of_the_first_input_has_the_newest_of_the_others() -> None:
    """Of its time or before; black before the first, the last one after the end."""
    found = compose([(0, 1), (40, 2), (80, 3), (120, 4)], [(0, 9), (60, 8), (80, 7)])
    assert found == [(0, 1, 9), (40, 2, 9), (80, 3, 7), (120, 4, 7)]


def test_the_stream_ends_with_the_first_input() -> None:
    """However long the others are; more than are held wait."""
    found = compose([(0, 1), (40, 2)], [(40 * n, n) for n in range(50)])
    assert found == [(0, 1, 0), (40, 2, 1)]
    found = compose([(40 * n, n) for n in range(50)], [(0, 7)])
    assert found == [(40 * n, n, 7) for n in range(50)]


def test_pairs_do_not_depend_on_threads() -> None:
    """The same frames whichever branch is slower."""
    found = []
    for slow, fast in (("identity sleep-time=3000", "identity"), ("identity", "identity sleep-time=3000")):
        text = (
            "videotestsrc num-buffers=30 pattern=ball ! video/x-raw, format=BGR, width=64, height=48 "
            f"! tee name=t ! queue ! {slow} ! compositor name=c ! appsink name=out max-buffers=100  "
            f"t. ! queue ! {fast} ! c."
        )
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            frames = list(pipeline["out"])
        assert len(frames) == 30
        assert all(np.array_equal(frame.data[:, :64], frame.data[:, 64:]) for frame in frames)
        found.append([frame.data.tobytes() for frame in frames])
    assert found[0] == found[1]


def test_videos_of_several_heights_are_aligned_at_the_top() -> None:
    """The rest is black; a videoconvert makes the format the same."""
    text = (
        "compositor name=c ! appsink name=out  "
        "videotestsrc num-buffers=2 pattern=white ! video/x-raw, format=GRAY8, width=8, height=4 ! c.  "
        "videotestsrc num-buffers=2 pattern=white ! video/x-raw, format=I420, width=4, height=2 ! c."
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frame = next(iter(pipeline["out"]))
        assert [element.factory for element in pipeline.graph.inserted] == ["videoconvert", "videoconvert"]
    assert str(frame.caps["format"]) == "BGR"
    assert frame.data.shape == (4, 12, 3)
    assert frame.data[:2].min() > 200
    assert frame.data[2:, 8:].max() == 0


def test_a_frame_without_a_time_is_refused() -> None:
    """The error names the pad."""
    with Pipeline.parse(TWO) as pipeline:
        pipeline["b"].push(Frame(image(1), caps()))
        pipeline["a"].end()
        pipeline["b"].end()
        with pytest.raises(
            ElementFailure, match=r"c.sink_1: frames are composed by time, this one has no pts"
        ):
            pipeline.run(LIMIT_S)


def test_rates_may_lie_far_apart() -> None:
    """What has come between two frames of the first input does not fill the room of another."""
    found = compose([(0, 1), (1000, 2), (2000, 3)], [(20 * n, n) for n in range(101)])
    assert found == [(0, 1, 0), (1000, 2, 50), (2000, 3, 100)]


def test_a_flush_of_a_paused_pipeline_returns() -> None:
    """An input waits in the sink with the lock of all inputs."""
    text = (
        "videotestsrc num-buffers=40 ! compositor name=c ! fakesink name=k  "
        "videotestsrc num-buffers=40 ! queue max-size-buffers=3 ! c."
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(LIMIT_S)
        flushing = threading.Thread(target=pipeline.flush)
        flushing.start()
        flushing.join(LIMIT_S)
        assert not flushing.is_alive()
        pipeline.play()
        message = pipeline.wait(LIMIT_S)
        assert message is not None
        assert message.error is None
        assert pipeline["k"].count > 20


def test_an_input_that_waits_for_room_goes_on_after_a_flush() -> None:
    """The frames for which it waited are gone."""
    with Pipeline.parse(TWO) as pipeline:
        pipeline.play()
        for number in range(10):
            pipeline["a"].push(Frame(image(number), caps(), pts=40 * number * MS))
        assert wait_for(lambda: pipeline["c"].is_waiting)
        pipeline.flush()
        pipeline["b"].push(Frame(image(7), caps(), pts=400 * MS))
        pipeline["a"].end()
        pipeline["b"].end()
        message = pipeline.wait(LIMIT_S)
        assert message is not None
        assert message.error is None
