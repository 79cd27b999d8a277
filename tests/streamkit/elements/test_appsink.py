"""appsink: frames for the application."""

import threading

import pytest

from streamkit import ElementFailure, Frame, Pipeline
from streamkit.elements import appsink
from streamkit.elements.appsink import AppSink
from streamkit.errors import DescriptionError, StateError


def test_iteration_ends_with_eos() -> None:
    """ask-eos: all frames, then None."""
    with Pipeline.parse("fakesrc num-buffers=3 ! appsink name=out") as pipeline:
        pipeline.play()
        assert [frame.seq for frame in pipeline["out"]] == [0, 1, 2]
        assert pipeline["out"].pull() is None
        assert pipeline["out"].pull() is None


def test_iteration_raises_the_pipelines_error() -> None:
    """Frames before the error are returned first."""
    with Pipeline.parse("fakesrc num-buffers=9 ! identity error-after=3 ! appsink name=out") as pipeline:
        pipeline.play()
        frames = iter(pipeline["out"])
        assert [next(frames).seq, next(frames).seq] == [0, 1]
        with pytest.raises(ElementFailure, match=r"^identity0: error-after=3"):
            next(frames)


def test_a_full_sink_waits() -> None:
    """ask-drop: no frame is lost."""
    with Pipeline.parse("fakesrc num-buffers=30 ! appsink name=out max-buffers=2") as pipeline:
        pipeline.play()
        assert [frame.seq for frame in pipeline["out"]] == list(range(30))


def test_a_full_sink_may_drop_the_oldest() -> None:
    """ask-drop: the last two of ten frames remain; the others are counted."""
    with Pipeline.parse("fakesrc num-buffers=10 ! appsink name=out max-buffers=2 drop=true") as pipeline:
        pipeline.play()
        assert pipeline.ended.wait(10)
        assert [frame.seq for frame in pipeline["out"]] == [8, 9]
        assert pipeline["out"].drops == {"appsink full, oldest dropped": 8}


def test_pull_times_out() -> None:
    """ask-timeout: the message has the time limit."""
    with Pipeline.parse("appsrc ! appsink name=out") as pipeline:
        pipeline.play()
        with pytest.raises(StateError, match=r"^out: no frame has come within 0.01 s$"):
            pipeline["out"].pull(timeout_s=0.01)


def test_a_pipeline_that_does_not_play_has_no_frames() -> None:
    """The error names the remedy; frames from before the stop can still be pulled."""
    pipeline = Pipeline.parse("fakesrc num-buffers=2 ! appsink name=out")
    with pytest.raises(
        StateError, match=r"^out: no frames: the pipeline does not play; call play\(\) first$"
    ):
        pipeline["out"].pull()
    with pipeline:
        pipeline.play()
        assert pipeline.ended.wait(10)
    assert pipeline["out"].pull().seq == 0


def test_a_stop_wakes_a_waiting_pull() -> None:
    """Before its timeout."""
    pipeline = Pipeline.parse("appsrc ! appsink name=out")
    pipeline.play()
    outcome: list[str] = []

    def pull() -> None:
        try:
            pipeline["out"].pull(timeout_s=60.0)
        except StateError as error:
            outcome.append(str(error))

    waiting = threading.Thread(target=pull)
    waiting.start()
    pipeline.stop()
    waiting.join(10)
    assert outcome == ["out: no frames: the pipeline does not play; call play() first"]


def test_a_stop_ends_an_iteration() -> None:
    """A loop in another thread ends, as at EOS; one that begins later says that nothing plays."""
    pipeline = Pipeline.parse("fakesrc is-live=true ! appsink name=out")
    pipeline.play()
    frames: list[Frame] = []
    has_begun, is_over = threading.Event(), threading.Event()

    def iterate() -> None:
        for frame in pipeline["out"]:
            frames.append(frame)
            has_begun.set()
        is_over.set()

    threading.Thread(target=iterate).start()
    assert has_begun.wait(10)
    pipeline.stop()
    assert is_over.wait(10)
    with pytest.raises(StateError, match=r"does not play; call play\(\) first$"):
        list(pipeline["out"])


@pytest.mark.parametrize("is_live", [False, True])
def test_an_iteration_waits_for_a_live_source(monkeypatch: pytest.MonkeyPatch, is_live: bool) -> None:
    """A feed that is away gives no frame until it is back; of any other an iteration says that none comes."""
    monkeypatch.setattr(appsink, "ITERATION_TIMEOUT_S", 0.01)
    with Pipeline.parse(f"appsrc name=in is-live={is_live} ! appsink name=out") as pipeline:
        pipeline.play()
        frames: list[Frame] = []
        outcome: list[str] = []

        def iterate() -> None:
            try:
                frames.extend(pipeline["out"])
            except StateError as error:
                outcome.append(str(error))

        iterating = threading.Thread(target=iterate)
        iterating.start()
        iterating.join(0.5 if is_live else 20)
        assert iterating.is_alive() is is_live
        pipeline["in"].push(b"1", pts=0)
        pipeline["in"].end()
        iterating.join(20)
    assert (len(frames), len(outcome)) == ((1, 0) if is_live else (0, 1))


def test_it_takes_the_caps_it_is_given() -> None:
    """asr-caps: the property bounds what is negotiated."""
    with Pipeline.parse("fakesrc num-buffers=1 ! appsink name=out caps=a/b,x=1") as pipeline:
        pipeline.play()
        (frame,) = pipeline["out"]
    assert str(frame.caps) == "a/b, x=(int)1"
    with pytest.raises(DescriptionError, match="disagree on x"):
        Pipeline.parse("fakesrc ! a/b,x=2 ! appsink caps=a/b,x=1")


def test_frames_of_an_earlier_run_are_forgotten() -> None:
    """Every run begins with an empty sink."""
    pipeline = Pipeline.parse("fakesrc num-buffers=3 ! appsink name=out")
    for _ in range(2):
        with pipeline:
            pipeline.play()
            assert pipeline.ended.wait(10)
    assert pipeline["out"].pull().seq == 0
    assert [pipeline["out"].pull().seq for _ in range(2)] == [1, 2]


def test_a_failure_that_comes_as_a_pull_looks_is_raised() -> None:
    """The sink gets EOS after it: without the error, the frames so far would count as all."""
    sink, failure = AppSink("out"), StateError("as the test wants")
    sink.is_playing = True
    looks = iter([None, failure])

    def fail_and_end() -> Exception | None:
        sink.drain()
        return next(looks)

    sink.pipeline_error = fail_and_end
    with pytest.raises(StateError, match="as the test wants"):
        sink.try_pull(10.0)
