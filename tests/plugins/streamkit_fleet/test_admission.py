"""Admission: what a feed costs, and which feeds a machine cannot hold."""

import time

from streamkit import Pipeline, Transform
from streamkit_fleet.feed import WINDOW_FRAMES, CostMeter, excess
from streamkit_fleet.feeds import FeedSpec

WORK_S = 0.004


class Worker(Transform):
    """Needs a fixed processor time per frame."""

    sink = src = "ANY"

    def transform(self, frame):
        end_s = time.thread_time() + WORK_S
        while time.thread_time() < end_s:
            continue
        return frame


def measured(source: str, frame_rate: float) -> float:
    """Cores after a run of all frames of a source."""
    with Pipeline.parse(f"{source} ! worker ! fakesink") as pipeline:
        meter = CostMeter(pipeline, frame_rate)
        pipeline.play()
        while pipeline.wait(0.01) is None:
            meter.update()
        return meter.cores


def test_the_cost_is_that_of_a_frame_times_the_rate(register) -> None:
    """A run of less than two windows is not measured."""
    register(worker=Worker)
    assert WORK_S * 25 <= measured(f"fakesrc num-buffers={3 * WINDOW_FRAMES}", 25.0) < WORK_S * 25 * 3
    assert measured(f"fakesrc num-buffers={WINDOW_FRAMES}", 25.0) == 0.0


def test_rare_frames_are_measured_after_a_few(register) -> None:
    """A feed of few pictures per second is not waited for until it has a hundred."""
    register(worker=Worker)
    assert measured("fakesrc num-buffers=25 is-live=true ! identity sleep-time=200000", 1.0) > WORK_S


def test_the_last_and_nicest_of_the_new_feeds_are_refused_until_there_is_room() -> None:
    """Feeds that run already stay, even if they need more than there is."""
    feeds = {"a": FeedSpec(), "b": FeedSpec(), "c": FeedSpec(nice=5), "d": FeedSpec()}
    needs = dict.fromkeys(feeds, 0.75)
    assert list(excess(needs, 3.0, feeds)) == []
    assert list(excess(needs, 2.0, feeds)) == ["c", "d"]
    assert list(excess(needs, 0.5, {"a": FeedSpec()})) == ["a"]
    assert excess(needs, 2.5, feeds)["c"] == (
        "no room: for 25 frames/s it needs 0.75 of 2.5 cores, and the other feeds there 2.25; "
        "set its cores to 0.75, or a lower frame_rate"
    )
