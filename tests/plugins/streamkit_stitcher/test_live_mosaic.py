"""The live mosaic in pipelines."""

import math
import threading

import cv2
import numpy as np
import pytest

from streamkit import ElementFailure, MessageKind, Pipeline, Registration
from streamkit_stitcher.mosaic.mosaic import Mosaic

SOURCE = "dronetestsrc num-buffers=20 speed=40 ! video/x-raw, format=I420, width=480, height=270"
SMALL = "video/x-raw, format=BGR, width=160, height=120"


def keyframes(frames):
    """How many of some frames are keyframes."""
    return sum(frame.get(Registration).keyframe for frame in frames)


def mosaic_message(pipeline):
    """The fields of the message `mosaic`."""
    while (message := pipeline.bus.pop(0.0)) is not None:
        if message.kind is MessageKind.ELEMENT and message.fields["name"] == "mosaic":
            return message.fields
    return None


def play(location, out="", branch=""):
    """A pipeline that plays: a flight to `out`, whose mosaic goes to `branch` as it grows."""
    pipeline = Pipeline.parse(
        f"{SOURCE} ! stitch name=s location={location} preview-interval=0 ! appsink name=out {out} {branch}"
    )
    pipeline.play()
    return pipeline


def worker_threads():
    """The threads that paint."""
    return [thread for thread in threading.enumerate() if thread.name.endswith(" mosaic")]


def test_a_slow_preview_consumer_delays_no_frame(tmp_path):
    """All frames pass while no preview is taken; the last preview shows the whole mosaic."""
    branch = f"s.mosaic ! {SMALL} ! appsink name=slow max-buffers=1"
    with play(tmp_path / "m.png", branch=branch) as pipeline:
        passed = list(pipeline["out"])
        assert len(passed) == 20
        whole = cv2.imread(str(tmp_path / "m.png"))
        shown = list(pipeline["slow"])
    places = [frame.get(Registration).to_reference for frame in shown]
    assert len(shown) >= 1
    # The last fits all of the ground into as many pixels, at 1, 3/4, 1/2, 3/8, ...
    least, found = max(whole.shape[1] / 160, whole.shape[0] / 120), places[-1][0, 0]
    assert least <= found < 2 * least
    assert any(math.log2(factor * found).is_integer() for factor in (1, 3))


def test_the_stream_goes_on_while_the_mosaic_is_painted(tmp_path, monkeypatch):
    """Blocked painting delays no frame; after a stop the mosaic has every keyframe."""
    paint, begun = Mosaic.add, threading.Event()
    with Pipeline.parse(
        f"{SOURCE} ! stitch name=s location={tmp_path}/m.png final=false ! appsink name=out"
    ) as pipeline:

        def add(self, frame, *place):
            if frame.ndim == 3:  # not the outlines
                begun.set()
                assert pipeline["s"].stopping.wait(60)
            return paint(self, frame, *place)

        monkeypatch.setattr(Mosaic, "add", add)
        pipeline.play()
        passed = [frame for _, frame in zip(range(19), pipeline["out"], strict=False)]
        assert begun.wait(30)
        assert not (tmp_path / "m.png").exists()
        pipeline.stop()
        written = mosaic_message(pipeline)
    assert written["pictures"] >= keyframes(passed) > 2
    assert (tmp_path / "m.png").exists()
    assert not worker_threads()


@pytest.mark.parametrize("final", ["true", "false"])
def test_the_same_frames_give_the_same_mosaic(tmp_path, final):
    """With or without a preview consumer, however slow, the file is the same bit for bit."""
    files = []
    for number, look in enumerate(("", f"s.mosaic ! {SMALL} ! appsink max-buffers=1 drop=true")):
        path = tmp_path / f"{number}.png"
        text = f"{SOURCE} ! stitch name=s location={path} final={final} preview-interval=0 ! fakesink {look}"
        Pipeline.parse(text).run(timeout_s=60)
        files.append(path.read_bytes())
    assert files[0] == files[1]


def test_a_failure_of_the_background_thread_fails_the_pipeline(tmp_path, monkeypatch):
    """A failure of the background thread ends the stream with an error that names the element."""

    def add(self, frame, *place):
        raise ValueError("no paint")

    monkeypatch.setattr(Mosaic, "add", add)
    text = f"{SOURCE} ! stitch name=ground location={tmp_path}/m.png final=false ! fakesink"
    with pytest.raises(ElementFailure, match=r"ground.*no paint"):
        Pipeline.parse(text).run(timeout_s=60)
    assert not worker_threads()


def test_a_preview_branch_can_be_added_and_removed(tmp_path):
    """A branch that is linked to the pad while frames pass gets frames; without it the rest goes on."""
    with play(tmp_path / "m.png", "max-buffers=2") as pipeline:
        frames = iter(pipeline["out"])
        next(frames)
        branch = pipeline.add_branch("s", f"queue ! {SMALL} ! appsink name=shown")
        passed = [next(frames) for _ in range(8)]
        assert next(iter(pipeline["shown"])).data.shape == (120, 160, 3)
        pipeline.remove_branch(branch)
        passed += list(frames)
    assert len(passed) == 19
    assert (tmp_path / "m.png").exists()


def test_after_a_flush_the_mosaic_goes_on(tmp_path):
    """A flush drops what waits to be shown and loses no ground."""
    branch = f"s.mosaic ! queue ! {SMALL} ! appsink name=shown"
    with play(tmp_path / "m.png", "max-buffers=4", branch) as pipeline:
        frames = iter(pipeline["out"])
        before = [next(frames) for _ in range(5)]
        pipeline.flush()
        after = list(frames)
        shown = list(pipeline["shown"])
    assert len(after) >= 5
    assert len(before) == 5
    assert len(shown) >= 1
    assert np.isfinite(shown[-1].get(Registration).to_reference).all()
    assert cv2.imread(str(tmp_path / "m.png")).shape[1] > 520


def test_each_plane_is_written_in_the_background(tmp_path):
    """Where the scene is cut the stream does not wait for the file; by EOS there is one of each plane."""
    random = np.random.default_rng(5)
    for number in range(6):
        if number % 3 == 0:
            ground = cv2.resize(random.integers(0, 255, (60, 110), dtype=np.uint8), (880, 480))
        left = 80 * (number % 3)
        cv2.imwrite(str(tmp_path / f"p{number}.png"), ground[40:400, left : left + 640])
    text = (
        f"multifilesrc location={tmp_path}/p%d.png ! decode ! stitch location={tmp_path}/m-%d.png "
        "! appsink name=out"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        planes = [frame.get(Registration).reference for frame in pipeline["out"]]
    assert planes == [0, 0, 0, 1, 1, 1]
    widths = [cv2.imread(str(tmp_path / f"m-{plane}.png")).shape[1] for plane in (0, 1)]
    assert widths == [pytest.approx(800, abs=2)] * 2
