"""funnel, as GStreamer's own tests have it."""

from streamkit import MessageKind, Pipeline


def test_all_frames_of_all_inputs_and_one_eos() -> None:
    """Two finite sources of 3 and 5 frames: 8 frames arrive, and exactly one EOS."""
    text = "funnel name=f ! fakesink name=end  fakesrc num-buffers=3 ! f.  fakesrc num-buffers=5 ! f."
    with Pipeline.parse(text) as pipeline:
        eos = []
        pipeline.bus.watch(lambda message: eos.append(message) if message.kind is MessageKind.EOS else None)
        pipeline.run(10)
        assert pipeline["end"].count == 8
        assert len(eos) == 1


def test_order_within_an_input_is_kept() -> None:
    """Frames of one input stay in order, whatever the other does between them."""
    text = (
        "funnel name=f ! appsink name=out  fakesrc num-buffers=50 ! queue ! f.  fakesrc num-buffers=50 ! f."
    )
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        numbers = [frame.seq for frame in pipeline["out"]]
    assert sorted(numbers) == sorted([*range(50), *range(50)])
    first_seen: list[int] = []
    for number in numbers:
        if number not in first_seen:
            first_seen.append(number)
    assert first_seen == sorted(first_seen)
