"""fakesrc: frames without content."""

import pytest

from streamkit import Pipeline
from tests.frames import frames_of


@pytest.mark.parametrize("count", [0, 1, 3])
def test_a_number_of_frames_then_eos(count: int) -> None:
    """fs-num: exactly so many; 0 means EOS at once."""
    assert [frame.seq for frame in frames_of(f"fakesrc num-buffers={count}")] == list(range(count))


def test_endless_by_default() -> None:
    """fs-num: -1 goes on until it is stopped."""
    with Pipeline.parse("fakesrc ! appsink name=out max-buffers=4") as pipeline:
        pipeline.play()
        assert [pipeline["out"].pull().seq for _ in range(500)] == list(range(500))


@pytest.mark.parametrize(("sizetype", "size"), [("empty", 0), ("fixed", 8192)])
def test_size_of_the_frames(sizetype: str, size: int) -> None:
    """fs-empty, fs-fixed: bytes of zero."""
    text = f"fakesrc num-buffers=2 sizetype={sizetype} sizemax=8192"
    assert [frame.data for frame in frames_of(text)] == [bytes(size)] * 2


def test_every_run_begins_at_zero() -> None:
    """fs-reuse: fakesrc ! queue ! sink three times."""
    pipeline = Pipeline.parse("fakesrc num-buffers=10 ! queue ! fakesink name=s")
    for _ in range(3):
        pipeline.run(timeout_s=10)
        assert pipeline["s"].count == 10
        assert pipeline["s"].last_frame.seq == 9


def test_a_paced_source_stops_at_once() -> None:
    """A wait between frames watches the stop."""
    with Pipeline.parse("fakesrc is-live=true ! appsink name=out") as pipeline:
        pipeline.play()
        times = [pipeline["out"].pull().arrival_ns for _ in range(3)]
    assert times[2] - times[0] >= 2 * 30_000_000
