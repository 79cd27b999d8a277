"""Negotiation between a src pad and its peer."""

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


def test_caps_are_in_the_order_of_downstream() -> None:
    """The preference of the receiver comes first."""
    src, _ = pads("a/b, f={ x, y, z }", "a/b, f={ z, y }")
    assert str(src.allowed_caps(Caps("a/b"))) == "a/b, f=(string){ z, y }"


def test_caps_of_the_element_bound_its_template() -> None:
    """The element may accept less than its template."""
    src, _ = pads("a/b", "a/b, f={ z, y }")
    assert src.allowed_caps(Caps("a/b, f=y")) == Caps("a/b, f=y")


def test_an_empty_intersection_is_refused() -> None:
    """The error names both pads, both caps, and the field in conflict."""
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
    """No error if downstream accepts the caps."""
    src, _ = pads("ANY", "a/b, width=[ 8, 16 ]")
    src.check_accepted(Caps("a/b, width=9, height=2"))
    alone = Pad(Element("e"), PadTemplate("src", Direction.SRC), "src")
    assert "nothing" in str(alone.refusal(Caps(), Caps()))


@pytest.mark.parametrize(
    ("accepted", "remedy"),
    [
        ("video/x-raw, width=8", "; put videoscale between"),
        ("video/x-raw, framerate=5/1", "; put videorate between"),
        ("video/x-raw, width=8, framerate=5/1", "; put videoscale ! videorate between"),
        ("video/x-raw, width=0", ""),
        ("video/x-raw, framerate=5", ""),
        ("video/x-raw, format=RGB", "; put videoconvert between"),
        ("video/x-raw, format=GRAY16_LE", ""),
        ("video/x-raw, format=RGB, width=8", ""),
    ],
)
def test_video_of_another_format_size_or_rate_gets_a_remedy(accepted: str, remedy: str) -> None:
    """Converters are inserted before frames bring their caps, and nothing is scaled: the error says how."""
    src, _ = pads("video/x-raw", accepted)
    fixed = Caps("video/x-raw, format=GRAY8, width=4, height=4, framerate=25/1")
    with pytest.raises(NotNegotiated) as caught:
        src.check_accepted(fixed)
    assert str(caught.value).partition("down.sink takes ")[2] == f"{Caps(accepted)}{remedy}"


@pytest.mark.parametrize(
    ("accepted", "remedy"),
    [
        (
            "video/x-raw, format={ I420, NV12 }",
            "frames of I420 and NV12 have even sizes; ask for GRAY8 or BGR",
        ),
        ("video/x-raw, format={ I420, RGB }", "put videoconvert between"),
        ("video/x-raw, format=BGR, width=4", "put videoscale between"),
    ],
)
def test_no_converter_is_recommended_for_a_size_that_a_format_lacks(accepted: str, remedy: str) -> None:
    """Its own error would be the next one."""
    src, _ = pads("video/x-raw", accepted)
    with pytest.raises(NotNegotiated, match=f"; {remedy}$"):
        src.check_accepted(Caps("video/x-raw, format=BGR, width=5, height=4, framerate=25/1"))
