"""States, pads and bins, as behaviour.md tells."""

from collections.abc import Callable, Iterator

import pytest

from streamkit import (
    Caps,
    DescriptionError,
    Direction,
    ElementFailure,
    Event,
    Frame,
    PadTemplate,
    Pipeline,
    Presence,
    Sink,
    Source,
    Transform,
)
from streamkit.element.registry import available_elements
from streamkit.graph.graph import Graph
from streamkit.graph.pipeline import State, StateChange

Register = Callable[..., None]
ANYTHING = Caps("a/b")


def names_from_sinks(text: str) -> list[str]:
    """Names of the elements in the order in which they are started."""
    return [element.name for element in Pipeline.parse(text).graph.from_sinks()]


def test_sinks_come_before_everything_upstream() -> None:
    """st-2sinks, st-sorted: both sinks first, the source last, whatever their order in the text."""
    order = names_from_sinks(
        "fakesrc name=s ! tee name=t t. ! queue name=a ! fakesink name=k t. ! queue name=b ! fakesink name=l"
    )
    assert set(order[:2]) == {"k", "l"}
    assert order[-2:] == ["t", "s"]


def test_the_order_follows_the_links() -> None:
    """st-semi: an element that takes frames and makes others stands where its links put it."""
    order = names_from_sinks("fakesink name=k fakesrc name=s ! identity name=i ! identity name=j ! k.")
    assert order == ["k", "j", "i", "s"]


def core_examples() -> Iterator[str]:
    """The example line of every core element."""
    for name, entry in available_elements().items():
        if "streamkit.elements." in entry.target:
            yield name


@pytest.mark.parametrize("name", list(core_examples()))
def test_every_core_element_goes_up_and_down(name: str) -> None:
    """st-updown: through all states and back, twice."""
    from streamkit.element.registry import element_class

    doc = element_class(name).__doc__ or ""
    example = doc.partition("Example:")[2].strip().partition("\n\n")[0]
    with Pipeline.parse(example) as pipeline:
        for _ in range(2):
            pipeline.ready()
            pipeline.pause()
            pipeline.play()
            pipeline.pause()
            pipeline.ready()
            assert pipeline.state is State.READY
            pipeline.stop()
            assert pipeline.state is State.NULL


def test_an_empty_pipeline_plays_at_once() -> None:
    """st-empty: there is nothing to wait for."""
    with Pipeline(Graph()) as pipeline:
        assert pipeline.play() is StateChange.SUCCESS
        assert pipeline.state is State.PLAYING


def test_a_file_source_prerolls_and_then_plays_at_once() -> None:
    """sk-srcsink: PAUSED is reached when the sink holds a frame, PLAYING needs no wait."""
    with Pipeline.parse("fakesrc ! fakesink") as pipeline:
        assert pipeline.pause() in (StateChange.ASYNC, StateChange.SUCCESS)
        assert pipeline.wait_prerolled(10)
        assert pipeline.pause() is StateChange.SUCCESS
        assert pipeline.play() is StateChange.SUCCESS


def test_one_live_source_makes_the_pipeline_live() -> None:
    """sk-mixed: NO_PREROLL wins, although the other sink could preroll."""
    text = "fakesrc is-live=true ! fakesink  fakesrc ! fakesink"
    with Pipeline.parse(text) as pipeline:
        assert pipeline.pause() is StateChange.NO_PREROLL


def test_a_sink_that_joins_a_paused_pipeline_is_waited_for() -> None:
    """sk-added: the state is told anew."""
    with Pipeline.parse("fakesrc ! tee name=t t. ! queue ! fakesink") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        pipeline.add_branch("t", "queue ! fakesink")
        assert pipeline.pause() is StateChange.ASYNC
        pipeline.play()
        assert pipeline.state is State.PLAYING


def test_unlinked_elements_do_not_start() -> None:
    """err-unlinked-state: the failure names the pad that nothing feeds."""
    with (
        Pipeline.parse("( fakesrc ) ( fakesink name=k )") as pipeline,
        pytest.raises(ElementFailure, match=r"^k .*pad sink"),
    ):
        pipeline.pause()


def test_messages_come_in_order() -> None:
    """bus-seq: states, the preroll, playing, the end."""
    with Pipeline.parse("fakesrc num-buffers=3 ! queue ! fakesink") as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(10)
        pipeline.play()
        told = []
        while (message := pipeline.bus.pop(10)) is not None:
            told.append(message.fields.get("state") or message.fields.get("name") or str(message.kind))
            if message.kind == "eos":
                break
    assert told == ["ready", "paused", "async-done", "playing", "eos"]


class Listening(Transform):
    """Writes down what passes."""

    sink = src = "ANY"

    def start(self) -> None:
        self.told: list[str] = []

    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        self.told.append("CapsEvent")

    def event(self, event: Event) -> None:
        self.told.append(type(event).__name__)

    def transform(self, frame: Frame) -> Frame:
        self.told.append("frame")
        return frame

    def drain(self) -> tuple[Frame, ...]:
        self.told.append("EosEvent")
        return ()


def test_events_come_in_order(register: Register) -> None:
    """pad-order: caps, segment, data, end; a source of anything sends no caps."""
    register(listening=Listening)
    for source, first in (("fakesrc num-buffers=1", []), ("videotestsrc num-buffers=1", ["CapsEvent"])):
        with Pipeline.parse(f"{source} ! listening name=l ! fakesink") as pipeline:
            pipeline.run(timeout_s=10)
            assert pipeline["l"].told == [*first, "SegmentEvent", "frame", "EosEvent"]


def test_what_was_agreed_reaches_a_pad_linked_later(register: Register) -> None:
    """pad-sticky: caps and segment come before the first frame of a branch that joins."""
    register(listening=Listening)
    with Pipeline.parse("videotestsrc ! tee name=t t. ! queue ! fakesink") as pipeline:
        pipeline.play()
        pipeline.add_branch("t", "listening name=l ! appsink name=out max-buffers=1")
        next(iter(pipeline["out"]))
        assert pipeline["l"].told[:3] == ["CapsEvent", "SegmentEvent", "frame"]


class Asking(Source):
    """Makes pads of two kinds on request."""

    templates = (
        PadTemplate("audio_%u", Direction.SRC, Caps("audio/x-raw"), Presence.REQUEST),
        PadTemplate("video_%u", Direction.SRC, Caps("video/x-raw"), Presence.REQUEST),
    )


class Watching(Sink):
    """Takes video."""

    sink = "video/x-raw"


def test_a_request_takes_the_template_that_fits(register: Register) -> None:
    """pad-request: the peer's caps, or the filter's, choose it; nothing fits where neither does."""
    register(asking=Asking, watching=Watching)
    links = [
        (src.path, sink.path) for src, sink in Pipeline.parse("asking name=a ! watching name=w").graph.links()
    ]
    assert links == [("a.video_0", "w.sink")]
    graph = Pipeline.parse("asking name=a ! audio/x-raw ! fakesink").graph
    assert next(src.path for src, _ in graph.links()) == "a.audio_0"
    with pytest.raises(DescriptionError):
        Pipeline.parse("asking ! text/x-raw ! fakesink")


@pytest.mark.parametrize(
    ("text", "works"),
    [
        ("fakesrc name=s fakesink name=k s. ! k.", True),
        ("fakesrc name=s fakesink name=k s.src ! k.", True),
        ("fakesrc name=s fakesink name=k s. ! k.sink", True),
        ("fakesrc name=s fakesink name=k s.src ! k.sink", True),
        ("fakesrc name=s fakesink name=k s.missing ! k.", False),
        ("fakesrc name=s fakesink name=k s. ! k.missing", False),
        ("fakesrc name=s fakesink name=k s.src ! k.src", False),
        ("fakesrc ! tee name=t fakesink name=k t. ! k.", True),
        ("fakesrc ! tee name=t fakesink name=k t.src_%u ! k.", True),
        ("fakesrc ! tee name=t fakesink name=k t.src_7 ! k.sink", True),
        ("fakesrc ! tee name=t fakesink name=k t.missing ! k.", False),
        ("fakesrc ! tee name=t fakesink name=k t.src_0 ! k.missing", False),
        ("fakesrc name=s funnel name=f s. ! f.  f. ! fakesink", True),
        ("fakesrc name=s funnel name=f s.src ! f.sink_3  f. ! fakesink", True),
        ("fakesrc name=s funnel name=f s. ! f.src  f. ! fakesink", False),
        ("fakesrc ! tee name=t funnel name=f t. ! f.  f. ! fakesink", True),
        ("fakesrc ! tee name=t funnel name=f t.src_1 ! f.sink_1  f. ! fakesink", True),
        ("fakesrc name=s fakesink name=k fakesink s. ! k. s. ! k.", False),
        ("videotestsrc ! audio/x-raw ! fakesink", False),
    ],
)
def test_links_by_template(text: str, works: bool) -> None:
    """link-tpl: static and request pads, named or not, missing, linked or of the wrong kind."""
    if works:
        assert list(Pipeline.parse(text).graph.links())
    else:
        with pytest.raises(DescriptionError) as caught:
            Pipeline.parse(text)
        assert caught.value.code in ("link", "no-such-pad")
