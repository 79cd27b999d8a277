"""Agreement between a src pad and what stands behind it."""

import pytest

from streamkit import Caps, Direction, Element, NotNegotiated, PadTemplate
from streamkit.element.pad import Pad


def pads(offered: str, accepted: str) -> tuple[Pad, Pad]:
    """Two linked pads with these templates."""
    upstream, downstream = Element("up"), Element("down")
    src = Pad(upstream, PadTemplate("src", Direction.SRC, Caps(offered)), "src")
    sink = Pad(downstream, PadTemplate("sink", Direction.SINK, Caps(accepted)), "sink")
    src.link(sink)
    return src, sink


def test_downstreams_order_rules() -> None:
    """Of what both can, the receiver's preference comes first."""
    src, _ = pads("a/b, f={ x, y, z }", "a/b, f={ z, y }")
    assert str(src.allowed_caps(Caps("a/b"))) == "a/b, f=(string){ z, y }"


def test_what_the_element_can_now_bounds_it() -> None:
    """The template is wide, the element's input may be narrow."""
    src, _ = pads("a/b", "a/b, f={ z, y }")
    assert src.allowed_caps(Caps("a/b, f=y")) == Caps("a/b, f=y")


def test_nothing_left_is_a_refusal_that_names_all() -> None:
    """Both pads, both caps, and the field in conflict."""
    src, sink = pads("a/b, width=4", "a/b, width=[ 8, 16 ]")
    text = (
        r"up.src -> down.sink: not negotiated, the pads disagree on width: "
        r"up.src offers a/b, width=\(int\)4; down.sink takes a/b, width=\(int\)\[ 8, 16 \]"
    )
    with pytest.raises(NotNegotiated, match=f"^{text}$"):
        src.allowed_caps(Caps("ANY"))
    with pytest.raises(NotNegotiated, match=f"^{text}$"):
        src.check_accepted(Caps("a/b, width=4"))
    assert sink.peer is src


def test_caps_that_fit_are_accepted() -> None:
    """No error where data and receiver agree."""
    src, _ = pads("ANY", "a/b, width=[ 8, 16 ]")
    src.check_accepted(Caps("a/b, width=9, height=2"))
    alone = Pad(Element("e"), PadTemplate("src", Direction.SRC), "src")
    assert "nothing" in str(alone.refusal(Caps(), Caps()))
