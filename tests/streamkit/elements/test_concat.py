"""concat, as GStreamer's own tests have it."""

from streamkit import Pipeline


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
