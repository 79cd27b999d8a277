"""concat, as GStreamer's own tests have it."""

import pytest

from streamkit import MessageKind, Pipeline
from streamkit.elements import concat


def test_inputs_follow_one_another() -> None:
    """All of input 0, then all of input 1, then one EOS; input 1 waits for its turn."""
    text = (
        "concat name=c ! appsink name=out  "
        "fakesrc num-buffers=3 sizetype=fixed sizemax=1 ! c.sink_0  "
        "fakesrc num-buffers=5 sizetype=fixed sizemax=2 ! c.sink_1"
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        sizes = [len(frame.data) for frame in pipeline["out"]]
    assert sizes == [1] * 3 + [2] * 5


def test_stop_while_an_input_waits() -> None:
    """Stopping wakes the input that waits for its turn."""
    text = "concat name=c ! fakesink  fakesrc ! c.sink_0  fakesrc num-buffers=5 ! c.sink_1"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        pipeline.stop()
        assert pipeline.state == "null"


@pytest.mark.parametrize("between", ["", "queue max-size-buffers=2 !"])
def test_an_input_that_holds_up_the_one_before_it_is_reported(
    monkeypatch: pytest.MonkeyPatch, between: str
) -> None:
    """Both come from one tee, which waits for the later input: a queue without limits is missing."""
    monkeypatch.setattr(concat, "STALL_S", 0.2)
    text = f"fakesrc num-buffers=50 ! tee name=t  t. ! {between} concat name=c ! fakesink  t. ! {between} c."
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        message = pipeline.bus.pop(10, (MessageKind.WARNING,))
    assert message is not None
    assert message.text.startswith("sink_1 waits for the end of sink_0, and t feeds both, so nothing moves: ")
    assert f"put queue {concat.UNLIMITED} between t and sink_1" in message.text


def test_an_input_that_waits_for_another_source_is_not_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """It waits as it should, also while the source before it has no frame."""
    monkeypatch.setattr(concat, "STALL_S", 0.2)
    with Pipeline.parse("concat name=c ! fakesink  appsrc ! c.  fakesrc num-buffers=2 ! c.") as pipeline:
        pipeline.play()
        assert pipeline.bus.pop(1, (MessageKind.WARNING,)) is None
