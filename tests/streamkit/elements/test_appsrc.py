"""appsrc: frames from the application."""

import contextlib
import threading

import numpy as np
import pytest

from streamkit import Caps, Frame, NotNegotiated, Pipeline, raw_video_caps
from streamkit.errors import ElementFailure, StateError

ANYTHING = Caps("a/b")


def push_many(pipeline: Pipeline, timeout_s: float) -> None:
    """Pushes more frames than there is room for."""
    for number in range(10):
        pipeline["in"].push(Frame(b"", ANYTHING, pts=number), timeout_s=timeout_s)


def test_frames_and_bare_data_come_in_order() -> None:
    """Bare data gets the caps of the property and the fields given; each has its number."""
    with Pipeline.parse("appsrc name=in caps=a/b,x=1 ! queue ! appsink name=out") as pipeline:
        pipeline.play()
        pipeline["in"].push(b"one", pts=5)
        pipeline["in"].push(Frame(b"two", Caps("a/b, x=1")))
        pipeline["in"].end()
        frames = list(pipeline["out"])
    assert [(f.data, f.pts, f.seq, str(f.caps)) for f in frames] == [
        (b"one", 5, 0, "a/b, x=(int)1"), (b"two", None, 1, "a/b, x=(int)1"),
    ]  # fmt: skip


def test_what_is_pushed_before_play_is_kept() -> None:
    """All of it, with the end, however many."""
    with Pipeline.parse("appsrc name=in max-buffers=2 ! appsink name=out max-buffers=0") as pipeline:
        for number in range(20):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=number))
        pipeline["in"].end()
        pipeline.play()
        assert [frame.pts for frame in pipeline["out"]] == list(range(20))


def test_new_caps_go_with_their_frames() -> None:
    """asr-caps2: each frame arrives with its own."""
    with Pipeline.parse("appsrc name=in ! identity ! appsink name=out") as pipeline:
        pipeline.play()
        for caps in ("a/b", "a/b", "c/d"):
            pipeline["in"].push(Frame(b"", Caps(caps)))
        pipeline["in"].end()
        assert [frame.caps.name for frame in pipeline["out"]] == ["a/b", "a/b", "c/d"]


def test_push_ends_when_the_pipeline_stops() -> None:
    """With the cause: the time limit has not passed."""
    with Pipeline.parse("appsrc name=in max-buffers=1 ! appsink name=out max-buffers=1") as pipeline:
        pipeline.play()
        threading.Timer(0.2, pipeline.stop).start()
        with pytest.raises(StateError, match=r"^in: the pipeline was stopped while a frame waited for room$"):
            push_many(pipeline, timeout_s=30)


def test_push_times_out_if_the_queue_is_full() -> None:
    """asr-block: nothing takes frames."""
    with Pipeline.parse("appsrc name=in max-buffers=1 ! appsink name=out max-buffers=1") as pipeline:
        pipeline.play()
        with pytest.raises(
            StateError, match=r"^in: no room for a frame within 0.05 s: nothing downstream takes it$"
        ):
            push_many(pipeline, timeout_s=0.05)
        assert pipeline["out"].pull().pts == 0
        pipeline["in"].push(Frame(b"", ANYTHING, pts=99))
        pipeline["in"].end()
        assert [frame.pts for frame in pipeline["out"]][-1] == 99


def test_leaky_appsrc_drops_the_oldest() -> None:
    """asr-limits: drops are counted."""
    with Pipeline.parse(
        "appsrc name=in max-buffers=2 block=false ! appsink name=out max-buffers=1"
    ) as pipeline:
        pipeline.play()
        for number in range(50):
            pipeline["in"].push(Frame(b"", ANYTHING, pts=number))
        pipeline["in"].end()
        arrived = [frame.pts for frame in pipeline["out"]]
        assert arrived == sorted(arrived)
        assert arrived[-1] == 49
        assert len(arrived) + pipeline["in"].drops["appsrc full, oldest dropped"] == 50


def test_a_push_after_the_end_is_refused() -> None:
    """asr-signals: until the next run."""
    pipeline = Pipeline.parse("appsrc name=in ! fakesink name=s")
    for _ in range(2):
        with pipeline:
            pipeline["in"].push(Frame(b"", ANYTHING))
            pipeline["in"].end()
            with pytest.raises(StateError, match=r"^in: no frame can follow end"):
                pipeline["in"].push(Frame(b"", ANYTHING))
            pipeline.play()
            assert pipeline.wait(10) is not None
            assert pipeline["s"].count == 1


def test_push_raises_the_error_of_the_pipeline() -> None:
    """In the thread of the application."""
    with Pipeline.parse("appsrc name=in max-buffers=1 ! identity error-after=1 ! fakesink") as pipeline:
        pipeline.play()
        with pytest.raises(ElementFailure, match="error-after"):
            push_many(pipeline, timeout_s=30.0)


def test_stopping_wakes_a_blocked_push() -> None:
    """asr-deadlock: the application's thread is let go at once, not after its time-out."""
    pipeline = Pipeline.parse("appsrc name=in max-buffers=1 ! appsink name=out max-buffers=1")
    pipeline.play()

    def push() -> None:
        with contextlib.suppress(StateError):
            push_many(pipeline, timeout_s=60.0)

    pushing = threading.Thread(target=push)
    pushing.start()
    pipeline["out"].pull()
    pipeline.stop()
    pushing.join(10)
    assert not pushing.is_alive()


def test_data_that_the_filter_refuses_is_an_error() -> None:
    """It names the pads and the field."""
    with Pipeline.parse("appsrc name=in ! a/b, x=1 ! fakesink") as pipeline:
        pipeline.play()
        pipeline["in"].push(Frame(b"", Caps("a/b, x=2")))
        message = pipeline.wait(10)
        assert message is not None
        assert isinstance(message.error, NotNegotiated)
        assert "disagree on x" in message.text


def test_none_is_refused_where_it_is_pushed() -> None:
    """It is what a failed read of OpenCV gives; the element behind would be blamed."""
    with Pipeline.parse(
        "appsrc name=in caps=video/x-raw,format=GRAY8,width=4,height=2 ! fakesink"
    ) as pipeline:
        pipeline.play()
        with pytest.raises(TypeError, match=r"in: push takes a frame or data, got None: .* call end"):
            pipeline["in"].push(None)


def test_an_array_without_caps_is_refused() -> None:
    """Its pixel format is unknown; bytes without caps may be anything and pass."""
    pipeline = Pipeline.parse("appsrc name=in ! fakesink")
    with pytest.raises(TypeError, match=r"in: an array needs caps.*raw_video_caps"):
        pipeline["in"].push(np.zeros((4, 4), np.uint8))
    pipeline["in"].push(b"bytes")
    pipeline["in"].caps = raw_video_caps("GRAY8", 4, 4)
    pipeline["in"].push(np.zeros((4, 4), np.uint8))


def test_a_part_of_an_array_that_is_written_into_again_is_copied() -> None:
    """Only the part would be read-only, and the frames in the pipeline would all show the last picture."""
    buffer, caps = np.zeros((2, 4, 2), np.uint8), raw_video_caps("GRAY8", 4, 2)
    with Pipeline.parse("appsrc name=in ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        for number in range(3):
            buffer[:] = number
            pipeline["in"].push(Frame(buffer[..., 0], caps))
        pipeline["in"].end()
        assert [int(frame.data.max()) for frame in pipeline["out"]] == [0, 1, 2]


def test_a_converter_is_inserted_for_its_caps() -> None:
    """As behind a source that chooses its format; the error was about a media type EMPTY."""
    caps = "video/x-raw,format=BGR,width=64,height=48"
    with Pipeline.parse(f"appsrc name=in caps={caps} ! stitch ! appsink name=out") as pipeline:
        pipeline.play()
        pipeline["in"].push(np.zeros((48, 64, 3), np.uint8))
        pipeline["in"].end()
        assert [str(frame.caps["format"]) for frame in pipeline["out"]] == ["I420"]
