"""Counters of a running graph: every frame not delivered has a reason."""

import pytest

from streamkit import Pipeline


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


@pytest.mark.parametrize("probability", [1.0, 0.5])
def test_a_drop_has_a_reason(probability: float) -> None:
    """What came in and did not go out stands under its reason."""
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
