"""A bin in a process of its own: the same output as without, for anything that flows."""

import gc
import itertools
import os
from pathlib import Path

import numpy as np
import pytest

from streamkit import Frame
from streamkit.graph.pipeline import Pipeline

LIMIT_S = 80.0  # a busy machine takes long to start a process
VIDEO = "videotestsrc num-buffers=40 pattern=ball ! video/x-raw, format=GRAY8, width=160, height=120"


def run(description: str, watchdog_s: float = 30.0) -> list[Frame]:
    """Frames of the appsink `out`."""
    with Pipeline.parse(description, watchdog_s=watchdog_s) as pipeline:
        pipeline.play()
        return list(pipeline["out"])


def assert_same(found: list[Frame], wanted: list[Frame]) -> None:
    """Frames are the same, bit for bit."""
    assert len(found) == len(wanted)
    for frame, other in zip(found, wanted, strict=True):
        for name in ("pts", "duration", "epoch", "seq", "capture", "flags", "caps"):
            assert getattr(frame, name) == getattr(other, name)
        if isinstance(other.data, np.ndarray):
            assert frame.data.dtype == other.data.dtype
            assert frame.data.strides == other.data.strides
            assert not frame.data.flags.writeable
        assert np.array_equal(frame.data, other.data)
        assert [kind.__name__ for kind in frame.metadata] == [kind.__name__ for kind in other.metadata]


@pytest.mark.parametrize(
    "text",
    [
        f"{VIDEO} ! ( process=@ framediff ) ! appsink name=out",
        "( process=@ videotestsrc num-buffers=40 ) ! ( process=@ identity ! queue ) ! appsink name=out",
        "fakesrc num-buffers=99 sizetype=random filltype=pattern ! ( process=@ identity ) ! appsink name=out",
        f"{VIDEO} ! ( process=@ identity ) ! ( process=@ identity ) ! appsink name=out max-buffers=99",
        f"{VIDEO} ! tee name=t ! ( process=@ videoflip method=clockwise ) ! funnel name=f ! appsink name=out",
    ],
)
def test_output_is_the_same_as_in_one_process(text: str) -> None:
    """The description with `process=true` gives what it gives without."""
    assert_same(run(text.replace("@", "true")), run(text.replace("@", "false")))


def test_metadata_crosses_by_type() -> None:
    """A dataclass of any package with an element in the graph keeps its values, types and array layouts."""
    text = f"{VIDEO} ! ( process=@ marker ) ! appsink name=out"
    for found, wanted in itertools.islice(
        zip(run(text.replace("@", "true")), run(text.replace("@", "false")), strict=True), 3
    ):
        (mark,), (other,) = found.metadata.values(), wanted.metadata.values()
        assert type(mark) is type(other)
        assert (mark.text, mark.numbers) == (other.text, other.numbers)
        assert np.array_equal(mark.array, other.array)
        assert mark.array.flags.f_contiguous == other.array.flags.f_contiguous
        assert np.array_equal(mark.inner.array, other.inner.array)


def test_metadata_that_cannot_cross_is_an_error_that_names_it() -> None:
    """An object that is no dataclass is not left out."""
    with (
        Pipeline.parse(f"{VIDEO} ! ( process=true marker plain=true ) ! fakesink") as pipeline,
        pytest.raises(Exception, match=r"streamkit_misbehaving:Plain cannot reach another process"),
    ):
        pipeline.run(LIMIT_S)


def test_kept_frames_do_not_change() -> None:
    """An element may keep frames for as long as it likes: their memory is not used again."""
    frames = run(f"{VIDEO} ! ( process=true shm-frames=2 keeper ) ! appsink name=out max-buffers=100")
    assert len(frames) == 40


def test_a_slow_reader_holds_up_the_writer() -> None:
    """No more than `shm-frames` frames are on the way."""
    text = "fakesrc name=src ! ( process=true shm-frames=3 identity ) ! appsink name=out max-buffers=2"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = [pipeline["out"].pull(LIMIT_S).seq for _ in range(20)]
        sent = next(row for row in pipeline.statistics() if row.element == "src").frames_out
    assert frames == list(range(20))
    # Two links with three frames each, one in the hands of each thread, two in the sink.
    assert sent <= 20 + 3 + 3 + 2 + 4


def test_a_sink_in_a_process_ends_the_run() -> None:
    """EOS is posted once all sinks have ended, in whichever process."""
    with Pipeline.parse(
        f"{VIDEO} ! tee name=t ! ( process=true queue ! fakesink ) t. ! queue ! fakesink"
    ) as pipeline:
        pipeline.run(LIMIT_S)


def test_a_whole_pipeline_in_a_process() -> None:
    """Nothing is left for the main process to do."""
    with Pipeline.parse("( process=true fakesrc num-buffers=5 ! fakesink )") as pipeline:
        pipeline.run(LIMIT_S)


def test_an_error_is_told_as_if_it_were_here() -> None:
    """Element, frame and cause are those of the element."""
    texts = []
    for value in ("true", "false"):
        text = f"{VIDEO} ! ( process={value} doomed how=raise at=7 ) ! fakesink"
        with Pipeline.parse(text) as pipeline, pytest.raises(Exception, match="as the test wants") as error:
            pipeline.run(LIMIT_S)
        texts.append(str(error.value))
    assert texts[0] == texts[1]


def test_statistics_reach_into_the_process() -> None:
    """Each element has the counts that it has in one process; a link has what goes in and out."""
    rows = {}
    for value in ("true", "false"):
        with Pipeline.parse(
            f"{VIDEO} ! ( process={value} videoflip method=rotate-180 ! queue ) ! fakesink"
        ) as pipeline:
            pipeline.play()
            pipeline.wait(LIMIT_S)
            rows[value] = {row.element: row for row in pipeline.statistics()}
    for name, wanted in rows["false"].items():
        found = rows["true"][name]
        assert (found.frames_in, found.frames_out) == (wanted.frames_in, wanted.frames_out)
        assert found.dropped == wanted.dropped
        assert [pad.caps for pad in found.pads] == [pad.caps for pad in wanted.pads]
    assert rows["true"]["videoflip0"].busy_ns > 0
    for name in ("processlink0", "processlink1"):
        assert (rows["true"][name].frames_in, rows["true"][name].frames_out) == (40, 40)


def test_each_process_has_counters_of_its_own() -> None:
    """Processor time, memory, frames and crossings; a slow process makes the link into it wait."""
    text = f"{VIDEO} ! ( name=slow process=true shm-frames=2 identity sleep-time=5000 ) ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        pipeline.wait(LIMIT_S)
        main, child = pipeline.process_statistics()
    assert (main.process, main.pid, child.process) == ("main", os.getpid(), "slow")
    assert child.pid != main.pid
    assert (main.frames, main.crossings) == (child.frames, child.crossings) == (40, 80)
    assert main.cpu_ns > 0
    assert child.cpu_ns > 0
    assert main.waited_ns > 30 * 5_000_000
    assert min(main.rss_bytes, child.rss_bytes) > 10 * 2**20


def test_properties_change_in_the_process() -> None:
    """A live property that the application sets is that of the running element."""
    text = (
        "fakesrc num-buffers=99 ! ( process=true doomed name=d how=raise ) ! appsink name=out max-buffers=1"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline["d"].at = 60
        pipeline.play()
        assert pipeline["out"].pull(LIMIT_S).seq == 0
        pipeline["d"].set_property("at", 50)
        with pytest.raises(Exception, match=r"as the test wants \[at frame seq=50\]"):
            list(pipeline["out"])


def test_the_latency_of_elements_in_a_process_counts() -> None:
    """A queue with a minimum level delays live frames wherever it is."""
    found = []
    for value in ("true", "false"):
        inner = f"( process={value} queue min-threshold-time=9000000 )"
        text = f"fakesrc is-live=true ! {inner} ! fakesink sync=true"
        with Pipeline.parse(text) as pipeline:
            pipeline.play()
            found.append(pipeline.latency().minimum_ns)
    assert found[0] == found[1]


def test_start_again_after_a_stop() -> None:
    """A pipeline with processes plays a second time."""
    with Pipeline.parse(f"{VIDEO} ! ( process=true identity ) ! appsink name=out") as pipeline:
        for _ in range(2):
            pipeline.play()
            assert len(list(pipeline["out"])) == 40
            pipeline.stop()


def test_shared_memory_is_given_back_at_the_stop() -> None:
    """Neither half keeps buffers mapped while the pipeline object lives."""
    pipeline = Pipeline.parse(f"{VIDEO} ! ( process=true identity ) ! fakesink enable-last-sample=false")
    gc.collect()
    before = shared_buffers()  # of frames that earlier tests keep
    with pipeline:
        pipeline.play()
        pipeline.wait(LIMIT_S)
        assert shared_buffers() > before
    assert shared_buffers() <= before


def shared_buffers() -> int:
    """How many buffers for frames this process has mapped."""
    return Path("/proc/self/maps").read_text().count("streamkit-frame")
