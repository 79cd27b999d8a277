"""Statistics of a running graph."""

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from streamkit import ElementFailure, Frame, Pipeline, Property, Sink, Source, Transform
from streamkit.flow.caps import ANY
from streamkit.flow.statistics import PadStatistics, QueueLevels
from streamkit.testing import ManualClock

Register = Callable[..., None]


def test_queues_and_branches_are_counted() -> None:
    """Frames go in and out of every element, through threads and branches."""
    text = "fakesrc num-buffers=10 ! tee name=t  t. ! queue ! fakesink  t. ! queue ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.run(timeout_s=20)
        rows = {row.element: row for row in pipeline.statistics()}
    assert (rows["t"].frames_in, rows["t"].frames_out) == (10, 20)
    for name in ("queue0", "queue1"):
        assert (rows[name].frames_in, rows[name].frames_out) == (10, 10)
    assert rows["fakesink1"].frames_in == 10
    assert all(row.dropped == {} for row in rows.values())


class Forgetful(Transform):
    """Works on frames, and does not return them; counts those of one kind."""

    sink = src = "ANY"

    counts: bool = Property(False, doc="Count what is left out.")

    def transform(self, frame: Frame) -> None:
        if self.counts:
            self.count_drop("left out")


@pytest.mark.parametrize(("counts", "warnings"), [(False, 1), (True, 0)])
def test_a_transform_that_gave_nothing_is_reported(register: Register, counts: bool, warnings: int) -> None:
    """A forgotten `return` looks like a filter that drops everything: only counted frames are meant so."""
    register(forgetful=Forgetful)
    with Pipeline.parse(f"fakesrc num-buffers=7 ! forgetful counts={counts} ! fakesink") as pipeline:
        pipeline.run(timeout_s=20)
        messages = [message for message in iter(lambda: pipeline.bus.pop(0), None) if message.is_shortfall]
    assert [message.source for message in messages] == ["forgetful0"] * warnings
    assert all(message.text.startswith("none of 7 frames came out") for message in messages)
    assert all("`return` them" in message.text for message in messages)


def test_advice_for_authors_is_not_given_to_users(tmp_path: Path) -> None:
    """An element of streamkit has no `return` that its user could write."""
    Pipeline.parse(f"videotestsrc num-buffers=9 ! videofilesink location={tmp_path}/a.mp4").run(timeout_s=60)
    with Pipeline.parse(f"filesrc location={tmp_path}/a.mp4 start-s=9 ! decode ! fakesink") as pipeline:
        pipeline.run(timeout_s=60)
        messages = [message for message in iter(lambda: pipeline.bus.pop(0), None) if message.is_shortfall]
    texts = {message.source: message.text for message in messages}
    assert texts["decode0"] == "none of 9 frames came out"


def test_a_failed_run_is_not_said_to_have_given_nothing(tmp_path: Path) -> None:
    """The frames of an encoder come at EOS, and the first one meets the failure."""
    text = f"videotestsrc num-buffers=10 ! encode ! filesink location={tmp_path}/out.mp4"
    with Pipeline.parse(text) as pipeline:
        with pytest.raises(ElementFailure, match="write packetsink location="):
            pipeline.run(timeout_s=60)
        assert [message for message in iter(lambda: pipeline.bus.pop(0), None) if message.is_shortfall] == []


class Counting(Sink):
    """Looks at the statistics now and then, and fails at its 900th frame."""

    sink = "ANY"
    looked: list[tuple[int, int]]
    pipeline: Pipeline

    def start(self) -> None:
        self.looked, self._taken = [], 0

    def render(self, frame: Frame) -> None:
        self._taken += 1
        if self._taken % 97 == 0:
            self.looked.append((self._taken, _taken_in(self.pipeline)))
        if self._taken == 900:
            raise ValueError("enough")


def _taken_in(pipeline: Pipeline) -> int:
    return next(row.frames_in for row in pipeline.statistics() if row.element == "counting0")


def test_counts_are_right_at_every_moment(register: Register) -> None:
    """Behind a queue frames come in a row: each counts once it reaches the sink, none after a failure."""
    register(counting=Counting)
    with Pipeline.parse("fakesrc num-buffers=1000 ! queue ! counting") as pipeline:
        pipeline["counting0"].pipeline = pipeline
        with pytest.raises(ElementFailure, match="enough"):
            pipeline.run(timeout_s=30)
        assert pipeline["counting0"].looked == [(count, count) for count in range(97, 900, 97)]
        assert _taken_in(pipeline) == 900


@pytest.mark.parametrize("probability", [1.0, 0.5])
def test_a_drop_has_a_reason(probability: float) -> None:
    """Dropped frames are counted by reason."""
    with Pipeline.parse(
        f"fakesrc num-buffers=50 ! identity drop-probability={probability} ! fakesink"
    ) as pipeline:
        pipeline.run(timeout_s=20)
        row = next(row for row in pipeline.statistics() if row.element == "identity0")
    assert row.frames_in == 50
    assert row.dropped == {"drop-probability": 50 - row.frames_out}
    assert row.dropped["drop-probability"] > 0


def test_a_new_run_counts_anew() -> None:
    """Counters belong to one run."""
    with Pipeline.parse("fakesrc num-buffers=5 ! identity drop-probability=1 ! fakesink") as pipeline:
        for _ in range(2):
            pipeline.run(timeout_s=20)
            rows = {row.element: row for row in pipeline.statistics()}
            assert rows["fakesrc0"].frames_out == 5
            assert rows["identity0"].dropped == {"drop-probability": 5}


def test_before_a_run_everything_is_zero() -> None:
    """Statistics can be asked for at any time."""
    rows = Pipeline.parse("fakesrc ! fakesink").statistics()
    assert [(row.element, row.frames_in, row.busy_ns) for row in rows] == [
        ("fakesrc0", 0, 0),
        ("fakesink0", 0, 0),
    ]


class Works(Transform):
    """Takes some time for each frame."""

    sink = src = "ANY"

    def transform(self, frame: Frame) -> Frame:
        spin(2_000_000)
        return frame


class WorksSparingly(Transform):
    """The same, in a generator."""

    sink = src = "ANY"

    def transform(self, frame: Frame) -> Iterator[Frame]:
        spin(2_000_000)
        yield frame


def spin(span_ns: int) -> None:
    """Works for so many ns."""
    end = time.perf_counter_ns() + span_ns
    while time.perf_counter_ns() < end:
        pass


@pytest.mark.parametrize("kind", [Works, WorksSparingly])
def test_a_short_run_is_timed_as_well(register: Register, kind: type[Transform]) -> None:
    """From the first frame on; what a tee and a source call is not their own work."""
    register(works=kind)
    others = ("fakesrc0", "t", "fakesink0")
    least = dict.fromkeys(others, math.inf)  # of several runs: on a busy machine any element may have to wait
    for _ in range(5):
        with Pipeline.parse("fakesrc num-buffers=20 ! tee name=t ! works ! fakesink") as pipeline:
            pipeline.run(timeout_s=20)
            busy_ns = {row.element: row.busy_ns for row in pipeline.statistics()}
        assert busy_ns["works0"] >= 40_000_000 * 0.7
        least = {name: min(least[name], busy_ns[name]) for name in others}
    assert max(least.values()) < 40_000_000 * 0.7


def test_a_slow_source_is_busy_and_a_live_one_is_not(register: Register) -> None:
    """Time between frames is a source's work, unless it waits for frames that come at their own pace."""

    class Makes(Source):
        """Takes a while for each frame."""

        src = "ANY"
        live: bool = Property(False)

        def frames(self) -> Iterator[Frame]:
            self.is_live = self.live
            for _ in range(20):
                spin(2_000_000)
                yield Frame(b"", ANY)

    register(makes=Makes)
    for text, is_busy in (("makes", True), ("makes live=true", False)):
        with Pipeline.parse(f"{text} ! fakesink") as pipeline:
            pipeline.run(timeout_s=20)
            assert (pipeline.statistics()[0].busy_ns > 30_000_000) is is_busy


def test_the_age_is_that_of_the_newest_frame() -> None:
    """Since its arrival, on the pipeline's clock; elements that nothing has reached have none."""
    clock = ManualClock()
    pipeline = Pipeline.parse(
        "appsrc name=in ! identity ! tee name=t ! fakesink name=end  t. ! valve drop=1 ! fakesink name=dry",
        clock=clock,
    )
    with pipeline:
        pipeline.play()
        for seconds in (2, 3):
            pipeline["in"].push(Frame(b"", ANY, arrival_ns=clock.monotonic_ns()))
            clock.advance(seconds)
        pipeline["in"].end()
        assert pipeline.wait(10) is not None
        rows = {row.element: row for row in pipeline.statistics()}
    for name in ("in", "identity0", "t", "end"):
        assert rows[name].age_ns == 3_000_000_000, name
    assert rows["dry"].age_ns is None
    assert rows["dry"].frames_in == 0


def test_pads_tell_frames_caps_and_peer() -> None:
    """One row for each pad of the element."""
    with Pipeline.parse("fakesrc num-buffers=7 ! a/b,x=1 ! tee name=t ! fakesink") as pipeline:
        pipeline.play()
        assert pipeline.wait(10) is not None
        rows = {row.element: row for row in pipeline.statistics()}
    assert rows["t"].pads == [
        PadStatistics("sink", "sink", 7, "capsfilter0.src", "a/b, x=(int)1"),
        PadStatistics("src_0", "src", 7, "fakesink0.sink", "a/b, x=(int)1"),
    ]


def test_a_queue_reports_its_levels_and_the_highest() -> None:
    """Frames and bytes held now, and the most there were, within the limit."""
    with Pipeline.parse("appsrc name=in ! queue name=q max-size-buffers=3 ! valve name=v ! appsink name=out "
                        "max-buffers=1") as pipeline:  # fmt: skip
        pipeline.play()
        for number in range(5):  # one in the appsink, one before it, three in the queue
            pipeline["in"].push(Frame(bytes(10), ANY, seq=number))
        full = queue_levels(pipeline)
        while full.buffers < 3:
            full = queue_levels(pipeline)
        assert (full.bytes, full.limit_buffers) == (30, 3)
        pipeline["in"].end()
        assert len(list(pipeline["out"])) == 5
        rest = queue_levels(pipeline)
    assert (rest.buffers, rest.bytes, rest.max_buffers, rest.max_bytes) == (0, 0, 3, 30)


def queue_levels(pipeline: Pipeline) -> QueueLevels:
    """What the queue q holds."""
    levels = next(row.queue for row in pipeline.statistics() if row.element == "q")
    assert levels is not None
    return levels


class Warns(Sink):
    """Warns at every frame, fails at the third."""

    sink = "ANY"

    def render(self, frame: Frame) -> None:
        self.post_warning("dirty lens")
        if frame.seq == 2:
            raise OSError("broken lens")


def test_errors_and_warnings_are_counted(register: Register) -> None:
    """For the element they are from, anew in each run."""
    register(warns=Warns)
    pipeline = Pipeline.parse("fakesrc ! warns")
    for _ in range(2):
        with pytest.raises(ElementFailure):
            pipeline.run(timeout_s=20)
        rows = {row.element: row for row in pipeline.statistics()}
        assert (rows["warns0"].errors, rows["warns0"].warnings) == (1, 3)
        assert (rows["fakesrc0"].errors, rows["fakesrc0"].warnings) == (0, 0)


def test_waiting_with_sync_is_not_counted_as_work() -> None:
    """A sink is idle until a frame is due."""
    with Pipeline.parse(
        "videotestsrc num-buffers=10 ! video/x-raw,framerate=50/1 ! fakesink sync=true"
    ) as pipeline:
        pipeline.run(timeout_s=20)
        rows = {row.element: row for row in pipeline.statistics()}
    assert rows["fakesink0"].busy_ns < 90_000_000


def test_frames_of_a_removed_branch_stay_counted() -> None:
    """In the counters of the tee."""
    with Pipeline.parse("appsrc name=in ! tee name=t ! fakesink") as pipeline:
        pipeline.play()
        branch = pipeline.add_branch("t", "appsink name=out")
        pipeline["in"].push(Frame(b"", ANY))
        assert pipeline["out"].pull(timeout_s=10) is not None
        pipeline.remove_branch(branch)
        rows = {row.element: row for row in pipeline.statistics()}
    assert "out" not in rows
    assert (rows["t"].frames_in, rows["t"].frames_out) == (1, 2)


def test_a_transform_that_waits_is_not_busy() -> None:
    """What waits for time is no bottleneck."""
    text = "videotestsrc num-buffers=15 ! video/x-raw,framerate=50/1 ! identity sync=true name=i ! fakesink"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        assert pipeline.wait(20) is not None
        rows = {row.element: row for row in pipeline.statistics()}
    assert rows["i"].frames_in == 15
    assert rows["i"].busy_ns < 75_000_000  # of the 150 ms that it waits at least


def test_a_branch_may_join_while_the_counters_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its elements are counted from the next time on."""
    with Pipeline.parse("fakesrc ! tee name=t ! fakesink") as pipeline:
        pipeline.play()
        measure = pipeline._playback.rows

        def measure_and_add(now_ns: int) -> Any:
            rows = measure(now_ns)
            pipeline.add_branch("t", "fakesink")
            return rows

        monkeypatch.setattr(pipeline._playback, "rows", measure_and_add)
        assert [row.process for row in pipeline.process_statistics()] == ["main"]
