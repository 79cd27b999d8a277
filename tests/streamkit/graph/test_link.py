"""Links: the choice of pads."""

import re

import pytest

from streamkit import Caps, Direction, PadTemplate, Pipeline, Presence, Sink
from streamkit.element.registry import make_element
from streamkit.errors import DescriptionError, Place
from streamkit.graph.build import build
from streamkit.graph.link import LinkRequest, choose_pads


def links(text: str) -> list[str]:
    """All links as words, in the order of the elements."""
    return [f"{src.path} -> {sink.path}" for src, sink in build(text, {}).links()]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("fakesrc ! fakesink", ["fakesrc0.src -> fakesink0.sink"]),
        ("fakesrc .src ! .sink fakesink", ["fakesrc0.src -> fakesink0.sink"]),
        (
            "tee name=t  t. ! fakesink  t. ! fakesink",
            ["t.src_0 -> fakesink0.sink", "t.src_1 -> fakesink1.sink"],
        ),
        (
            "tee name=t  t.src_7 ! fakesink  t. ! fakesink",
            ["t.src_7 -> fakesink0.sink", "t.src_8 -> fakesink1.sink"],
        ),
        ("tee name=t  t.src_%u ! fakesink", ["t.src_0 -> fakesink0.sink"]),
        ("tee name=t t.src_1,src_2 ! fakesink", ["t.src_1 -> fakesink0.sink"]),
        ("fakesrc ! tee ! queue", ["fakesrc0.src -> tee0.sink", "tee0.src_0 -> queue0.sink"]),
    ],
)
def test_links(text: str, expected: list[str]) -> None:
    """Pads by name, the first that is free, or a new one on request."""
    assert links(text) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fakesrc name=a a. ! fakesink a. ! fakesink",
         "a has no free src pad: src is linked already; put a tee before it to feed several elements"),
        ("fakesrc name=a a.src ! fakesink a.src ! fakesink", "a.src is linked to fakesink0.sink already"),
        ("fakesink ! fakesink", "link has no source: fakesink0 has no src pad"),
        ("fakesrc ! fakesrc", "link has no sink: fakesrc1 has no sink pad"),
        ("fakesrc name=a a.video ! fakesink", "a has no pad 'video'; it has src"),
        ("fakesrc name=a a.sr ! fakesink", "a has no pad 'sr'; did you mean \"src\"?"),
        ("identity name=a a.sink ! fakesink", "a.sink is a sink pad, here a src pad is needed"),
        ("identity name=a a. ! a.", "a cannot be linked to itself"),
        ("tee name=t identity name=i t.src_0,src_1 ! i.sink", "2 pads of t cannot meet 1 pads of i"),
        ("tee name=t t.src_x ! fakesink", "t has no pad 'src_x'; did you mean \"src_%u\"?"),
    ],
)  # fmt: skip
def test_invalid_links(text: str, message: str) -> None:
    """Code `link`; the message names elements, pads and the remedy."""
    with pytest.raises(DescriptionError, match=f"^{re.escape(message)}$") as caught:
        build(text, {})
    assert caught.value.code == "link"


def test_the_error_is_at_the_link() -> None:
    """The caret is below the `!` or the filter."""
    text = "fakesrc name=a ! fakesink\na. ! fakesink"
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert caught.value.pointed(text).split("\n")[1:] == ["    a. ! fakesink", "       ^"]


@pytest.mark.parametrize(
    "text",
    [
        "tee name=t fakesrc ! t. t.srcc_0 ! fakesink",
        "funnel name=t fakesrc ! t.srcc_0",
        "tee name=t funnel name=f t.src_0,srcc_0 ! f.sink_0,sink_1",
    ],
)
def test_the_error_is_at_the_pads_name(text: str) -> None:
    """The caret is below the name that is wrong."""
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    place = caught.value.place
    assert text[place.column - 1 :][: place.length] == "srcc_0"


class OneInput(Sink):
    """A sink whose only request pad can be requested once."""

    sink = "ANY"
    templates = (PadTemplate("extra", Direction.SINK, Caps("ANY"), Presence.REQUEST),)

    def render(self, frame: object) -> None:
        """Takes every frame."""


def test_a_refused_link_leaves_no_pad() -> None:
    """A src pad that was requested for the link is released when the sink pad cannot be had."""
    tee, full, place = make_element("tee", "t"), OneInput("full"), Place()
    for _ in range(2):
        src, sink = choose_pads(LinkRequest(tee, "", full, "", place))
        src.link(sink)
    with pytest.raises(DescriptionError, match="full: a pad 'extra' is there already"):
        choose_pads(LinkRequest(tee, "", full, "", place))
    assert [pad.name for pad in tee.src_pads()] == ["src_0", "src_1"]


@pytest.mark.parametrize("element", ["stitch", "framediff"])
def test_the_main_pad_comes_first_where_a_converter_will_be_inserted(element: str) -> None:
    """Until then it can carry nothing; a pad on request, as that of a mask, is no substitute."""
    text = f"videotestsrc num-buffers=2 ! video/x-raw, format=BGR ! {element} name=e ! fakesink"
    assert "e.src -> fakesink0.sink" in links(text)
    Pipeline.parse(text).run(30)


@pytest.mark.parametrize("sink", ["trackoverlay", "compositor", "video/x-raw, format=BGR"])
def test_the_main_pad_comes_first_where_a_converter_is_needed_behind_it(sink: str) -> None:
    """The pad mosaic of stitch has BGR without one, but its frames are others."""
    found = links(f"videotestsrc num-buffers=2 ! stitch name=e ! {sink} ! fakesink")
    assert any(link.startswith("e.src -> videoconvert0.sink") for link in found)
    assert not any(link.startswith("e.mosaic") for link in found)
