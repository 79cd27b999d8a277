"""Pads and their templates."""

import pytest

from streamkit import Caps, CapsEvent, Direction, Element, EosEvent, Event, PadTemplate, Presence
from streamkit.element.pad import Pad
from streamkit.errors import StateError
from streamkit.flow.events import NotLinked
from streamkit.flow.frame import Frame

RAW = Caps("video/x-raw")


class Both(Element):
    """One pad on each side, and more on request; notes its events."""

    sink = "video/x-raw"
    src = "ANY"
    templates = (PadTemplate("src_%u", Direction.SRC, RAW, Presence.REQUEST),)

    def __init__(self, name: str = "") -> None:
        self.events: list[Event] = []
        super().__init__(name)

    def receive_event(self, pad: Pad, event: Event) -> None:
        self.events.append(event)


def test_templates_are_declared_and_always_pads_made() -> None:
    """Caps texts on the class are always pads; request pads are there when asked for."""
    assert set(Both.pad_templates) == {"sink", "src", "src_%u"}
    element = Both("b")
    assert list(element.pads) == ["sink", "src"]
    assert element.pads["sink"].path == "b.sink"
    assert repr(element.pads["src"]) == "<pad b.src>"
    assert [pad.name for pad in element.src_pads()] == ["src"]
    assert [pad.name for pad in element.sink_pads()] == ["sink"]


@pytest.mark.parametrize(
    ("template", "name", "matches"),
    [
        ("src_%u", "src_12", True),
        ("src_%u", "src_", False),
        ("src_%u", "src_a", False),
        ("src_%u", "sink_1", False),
        ("src", "src", True),
        ("src", "src_1", False),
        ("a_%u_b", "a_1_b", True),
        ("a_%u_b", "a_1", False),
    ],
)
def test_a_template_matches_names_with_a_number(template: str, name: str, matches: bool) -> None:
    """`%u` stands for digits and nothing else."""
    assert PadTemplate(template, Direction.SRC).matches(name) is matches


def test_request_pads_get_the_requested_or_next_name() -> None:
    """t-reqnames: automatic numbers continue from the highest."""
    element = Both("b")
    template = Both.pad_templates["src_%u"]
    names = [element.request_pad(template, name).name for name in ("src_%u", "src_100", "src_10", "")]
    assert names[:3] == ["src_0", "src_100", "src_10"]
    assert len(set(names)) == 4
    with pytest.raises(StateError, match=r"^b: a pad 'src_10' is there already$"):
        element.request_pad(template, "src_10")


def test_automatic_numbers_continue_after_named_ones() -> None:
    """r04: src_6 and src_7 follow src_5."""
    element = Both("b")
    template = Both.pad_templates["src_%u"]
    assert [element.request_pad(template, name).name for name in ("src_5", "", "")] == [
        "src_5",
        "src_6",
        "src_7",
    ]


def test_a_released_pad_is_unlinked_and_removed() -> None:
    """Its peer can be linked again."""
    upstream, downstream = Both("u"), Both("d")
    pad = upstream.request_pad(Both.pad_templates["src_%u"])
    pad.link(downstream.pads["sink"])
    upstream.release_pad(pad)
    assert "src_0" not in upstream.pads
    assert downstream.pads["sink"].peer is None


def test_a_link_has_two_ends() -> None:
    """Each pad knows the other; unlinking clears both."""
    upstream, downstream = Both("u"), Both("d")
    src, sink = upstream.pads["src"], downstream.pads["sink"]
    src.link(sink)
    assert (src.peer, sink.peer) == (sink, src)
    sink.unlink()
    assert (src.peer, sink.peer) == (None, None)


def test_a_push_without_a_peer_raises_not_linked() -> None:
    """err-push: the exception names the pad."""
    with pytest.raises(NotLinked, match=r"^u.src$"):
        Both("u").pads["src"].push(Frame(b"", RAW))


def test_caps_events_set_the_caps_of_both_pads() -> None:
    """Events reach the element behind; caps stay on the pads until reset."""
    upstream, downstream = Both("u"), Both("d")
    src, sink = upstream.pads["src"], downstream.pads["sink"]
    src.link(sink)
    src.send_event(CapsEvent(RAW))
    src.send_event(EosEvent())
    assert downstream.events == [CapsEvent(RAW), EosEvent()]
    assert src.caps == sink.caps == RAW
    assert downstream.sink_caps == RAW
    src.reset()
    assert src.caps is None


def test_an_event_on_an_unlinked_pad_is_kept_as_caps() -> None:
    """nego-unlinked: sending caps with no peer is no error."""
    pad = Both("u").pads["src"]
    pad.send_event(CapsEvent(RAW))
    assert pad.caps == RAW


def test_a_query_is_bounded_by_the_template() -> None:
    """A caps query never exceeds the template; without a peer it is the template."""
    upstream, downstream = Both("u"), Both("d")
    assert upstream.pads["src"].peer_caps().is_any
    upstream.pads["src"].link(downstream.pads["sink"])
    assert upstream.pads["src"].peer_caps() == RAW
