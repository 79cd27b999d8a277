"""input-selector and output-selector, as behaviour.md tells."""

import threading
from typing import Any

import pytest

from streamkit import Caps, Event, Frame, Pipeline, PropertyError, Sink
from streamkit.element.pad import Pad
from streamkit.element.registry import make_element
from streamkit.elements.inputselector import InputSelector
from streamkit.elements.outputselector import OutputSelector
from streamkit.flow.caps import ANY
from streamkit.flow.events import EOS, CapsEvent, EosEvent, SegmentEvent
from streamkit.testing import ManualClock

A = Caps("a/b")
SECOND = 1_000_000_000


class Outlet(Sink):
    """Notes what comes out."""

    sink = "ANY"
    accepts: Caps = ANY

    def __init__(self) -> None:
        super().__init__("outlet")
        self.seen: list[Any] = []

    def query_caps(self, pad: Pad) -> Caps:
        """What it takes."""
        return self.accepts

    def render(self, frame: Frame) -> None:
        """Notes the frame's number."""
        self.seen.append(frame.seq)

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Notes the event."""
        if not isinstance(event, CapsEvent | SegmentEvent):
            self.seen.append(event)


def frame(number: int, **fields: Any) -> Frame:
    """A frame."""
    return Frame(b"", A, seq=number, arrival_ns=1, **fields)


class Inputs:
    """An input-selector with some inputs."""

    def __init__(self, count: int = 2, **properties: Any) -> None:
        element = make_element("input-selector", "s", **properties)
        assert isinstance(element, InputSelector)
        self.element = element
        self.outlet = Outlet()
        element.pads["src"].link(self.outlet.pads["sink"])
        element.pads["src"].push = self.outlet.render
        self.pads = [element.request_pad(element.pad_templates["sink_%u"]) for _ in range(count)]
        self.takes = [element.receiver(pad) for pad in self.pads]
        element.start()
        element.is_playing = True

    def push(self, which: int, number: int, **fields: Any) -> None:
        """Pushes a frame into an input."""
        self.takes[which](frame(number, **fields))

    def push_from_thread(self, which: int, number: int, **fields: Any) -> threading.Thread:
        """Pushes from another thread, which may have to wait."""
        thread = threading.Thread(target=self.push, args=(which, number), kwargs=fields)
        thread.start()
        return thread

    @property
    def seen(self) -> list[Any]:
        """What came out."""
        return self.outlet.seen


def test_only_the_active_input_counts() -> None:
    """is-count: each in turn is active while all get frames; pushes into the others return."""
    inputs = Inputs(3)
    for active in range(3):
        inputs.element.set_property("active-pad", f"sink_{active}")
        for which in range(3):
            for number in range(4):
                inputs.push(which, 100 * active + 10 * which + number)
    assert inputs.seen == [100 * active + 10 * active + n for active in range(3) for n in range(4)]
    assert inputs.element.n_pads == 3


def test_eos_of_an_inactive_input_stays() -> None:
    """is-eos-inactive: it is not sent on."""
    inputs = Inputs()
    inputs.pads[1].receive_event(EOS)
    inputs.push(0, 1)
    assert inputs.seen == [1]


def test_a_shorter_inactive_input() -> None:
    """is-eos-short: it ends first, the active one goes on and its EOS passes."""
    inputs = Inputs()
    inputs.push(1, 10)
    inputs.pads[1].receive_event(EOS)
    inputs.push(0, 1)
    inputs.pads[0].receive_event(EOS)
    assert inputs.seen == [1, EOS]


def test_switching_to_an_input_that_has_ended() -> None:
    """is-switch-eos: EOS goes out at once."""
    inputs = Inputs()
    inputs.pads[1].receive_event(EOS)
    inputs.element.set_property("active-pad", "sink_1")
    assert inputs.seen == [EOS]


def test_the_first_input_is_active() -> None:
    """is-default: of 3 and 5 frames the 3 come out, then EOS; defaults are GStreamer's."""
    text = """input-selector name=s ! fakesink name=out
              fakesrc num-buffers=3 ! s.  fakesrc num-buffers=5 ! s."""
    pipeline = Pipeline.parse(text)
    pipeline.run(timeout_s=10)
    assert pipeline["out"].count == 3
    selector = pipeline["s"]
    assert (selector.sync_streams, selector.sync_mode.value) == (True, "active-segment")
    assert (selector.cache_buffers, selector.drop_backwards) == (False, False)


def test_inactive_inputs_keep_step() -> None:
    """is-default: with sync-streams an inactive input waits until the active one has got as far."""
    inputs = Inputs()
    inputs.push(0, 0, pts=0)
    waiting = inputs.push_from_thread(1, 10, pts=SECOND)
    waiting.join(0.1)
    assert waiting.is_alive()
    inputs.push(0, 1, pts=2 * SECOND)
    waiting.join(10)
    assert not waiting.is_alive()
    assert inputs.seen == [0, 1]


def test_switching_wakes_an_input() -> None:
    """is-count: a frame that waits in the input that becomes active goes out."""
    inputs = Inputs()
    inputs.push(0, 0, pts=0)
    waiting = inputs.push_from_thread(1, 10, pts=SECOND)
    inputs.element.set_property("active-pad", "sink_1")
    waiting.join(10)
    assert inputs.seen == [0, 10]


def test_inactive_inputs_may_follow_the_clock() -> None:
    """is-default: with sync-mode=clock they wait for the running time instead."""
    inputs = Inputs(sync_mode="clock")
    clock = ManualClock()
    inputs.element.clock = clock
    inputs.element.timing.begin()
    waiting = inputs.push_from_thread(1, 10, pts=SECOND)
    waiting.join(0.1)
    assert waiting.is_alive()
    clock.advance(1.5)
    waiting.join(10)
    assert not waiting.is_alive()


def test_frames_of_inactive_inputs_may_be_kept() -> None:
    """is-count: with cache-buffers those not older than the active one's come out after the switch."""
    inputs = Inputs(cache_buffers=True, sync_streams=False)
    for number in range(5):
        inputs.push(1, 10 + number, pts=number * SECOND, duration=SECOND)
    inputs.push(0, 0, pts=3 * SECOND)
    inputs.element.set_property("active-pad", "sink_1")
    inputs.push(1, 15, pts=5 * SECOND, duration=SECOND)
    assert inputs.seen == [0, 12, 13, 14, 15]


def test_frames_that_go_back_may_be_dropped() -> None:
    """is-count: with drop-backwards nothing older than what was passed on follows a switch."""
    inputs = Inputs(drop_backwards=True, sync_streams=False)
    inputs.push(0, 0, pts=5 * SECOND)
    inputs.element.set_property("active-pad", "sink_1")
    inputs.push(1, 10, pts=2 * SECOND)
    inputs.push(1, 11, pts=6 * SECOND)
    assert inputs.seen == [0, 11]


def test_a_pad_that_is_not_there_is_refused() -> None:
    """is-count: active-pad takes the name of a pad."""
    with pytest.raises(PropertyError, match=r"cannot be 's.sink_0': it takes the name of a pad"):
        InputSelector("s", active_pad="s.sink_0")


class Outputs:
    """An output-selector with some branches."""

    def __init__(self, *accepted: str, **properties: Any) -> None:
        element = make_element("output-selector", "s", **properties)
        assert isinstance(element, OutputSelector)
        self.element = element
        self.outlets = []
        for caps in accepted:
            outlet = Outlet()
            outlet.accepts = Caps(caps)
            pad = element.request_pad(element.pad_templates["src_%u"])
            pad.link(outlet.pads["sink"])
            pad.push = outlet.render
            self.outlets.append(outlet)
        self.sink = element.pads["sink"]
        self.take = element.receiver(self.sink)
        element.is_playing = True

    @property
    def seen(self) -> list[list[Any]]:
        """What came out of each."""
        return [outlet.seen for outlet in self.outlets]


def test_only_the_active_output_gets_frames() -> None:
    """os-count: each in turn, exactly its frames."""
    outputs = Outputs("ANY", "ANY", "ANY")
    for active in range(3):
        outputs.element.set_property("active-pad", f"src_{active}")
        for number in range(4):
            outputs.take(frame(10 * active + number))
    assert outputs.seen == [[0, 1, 2, 3], [10, 11, 12, 13], [20, 21, 22, 23]]


@pytest.mark.parametrize("mode", ["none", "all", "active"])
def test_without_outputs_anything_is_taken(mode: str) -> None:
    """os-nego-none: in every mode."""
    assert Outputs(pad_negotiation_mode=mode).sink.query_caps().is_any


@pytest.mark.parametrize(
    ("mode", "expected"),
    [("none", "ANY"), ("all", "a/b, x=(int)2"), ("active", "a/b, x=(int){ 2, 3 }")],
)
def test_whose_caps_count(mode: str, expected: str) -> None:
    """os-nego-mode0, os-nego-mode1, os-nego-mode2: nobody's, what all have in common, or the active one's."""
    outputs = Outputs("a/b, x={ 1, 2 }", "a/b, x={ 2, 3 }", pad_negotiation_mode=mode)
    outputs.element.set_property("active-pad", "src_1")
    assert str(outputs.sink.query_caps()) == expected


def test_the_first_output_is_active() -> None:
    """os-default: all frames go there; EOS goes to all."""
    outputs = Outputs("ANY", "ANY")
    for number in range(3):
        outputs.take(frame(number))
    outputs.sink.receive_event(EOS)
    assert outputs.seen == [[0, 1, 2, EosEvent()], [EosEvent()]]


def test_the_newest_frame_may_be_given_again() -> None:
    """os-count: with resend-latest a branch that becomes active gets it before the next one."""
    outputs = Outputs("ANY", "ANY", resend_latest=True)
    outputs.take(frame(0))
    outputs.element.set_property("active-pad", "src_1")
    outputs.take(frame(1))
    assert outputs.seen == [[0], [0, 1]]
