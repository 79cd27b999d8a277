"""Order of links: names, filters, link-all, and the first error."""

from collections.abc import Callable

import pytest

from streamkit import Caps, Direction, PadTemplate, Sink, Source
from streamkit.errors import DescriptionError
from streamkit.graph.build import build

Register = Callable[..., None]
FILTERED = {"fakesrc0.src -> capsfilter0.sink", "capsfilter0.src -> fakesink0.sink"}


def links(text: str) -> set[str]:
    """All links as words."""
    return {f"{src.path} -> {sink.path}" for src, sink in build(text, {}).links()}


def code(text: str) -> str:
    """The code of the error."""
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    return caught.value.code


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("fakesrc : fakesink", {"fakesrc0.src -> fakesink0.sink"}),
        ("fakesink : fakesrc", set()),
        ("fakesrc name=a : fakesink a. : fakesink", {"a.src -> fakesink0.sink"}),
        ("videotestsrc : audio/x-raw ! fakesink", set()),
        ("fakesrc : a/b : fakesink", FILTERED),
        ("fakesrc : a/b ! fakesink", FILTERED),
        ("fakesrc ! a/b : fakesink", FILTERED),
        ("tee name=t : fakesink", {"t.src_0 -> fakesink0.sink"}),
        ("tee name=t : funnel", {"t.src_0 -> funnel0.funnelpad0"}),
        ("fakesrc .src : .sink fakesink", {"fakesrc0.src -> fakesink0.sink"}),
    ],
)  # fmt: skip
def test_a_colon_links_all_pads_that_fit(text: str, expected: set[str]) -> None:
    """c01-c04, pl-ok-16..18: it never fails, and ends if both sides have request pads."""
    assert links(text) == expected


class Camera(Source):
    """Sound first, then video."""

    templates = (
        PadTemplate("sound", Direction.SRC, Caps("audio/x-raw")),
        PadTemplate("video", Direction.SRC, Caps("video/x-raw")),
    )


class Screen(Sink):
    """Takes video only."""

    sink = "video/x-raw"


class Speaker(Sink):
    """Takes sound only."""

    sink = "audio/x-raw"


def test_of_several_pads_the_one_that_fits_is_taken(register: Register) -> None:
    """Whatever their order; `:` takes all that fit."""
    register(camera=Camera, screen=Screen, speaker=Speaker)
    assert links("camera ! screen") == {"camera0.video -> screen0.sink"}
    assert links("camera name=c ! screen  c. ! speaker") == {
        "c.video -> screen0.sink", "c.sound -> speaker0.sink",
    }  # fmt: skip
    assert links("camera ! video/x-raw ! fakesink") == {
        "camera0.video -> capsfilter0.sink", "capsfilter0.src -> fakesink0.sink",
    }  # fmt: skip
    assert links("camera : funnel") == {
        "camera0.sound -> funnel0.funnelpad0", "camera0.video -> funnel0.funnelpad1",
    }  # fmt: skip
    assert links("camera : video/x-raw ! funnel") == {
        "camera0.video -> capsfilter0.sink", "capsfilter0.src -> funnel0.funnelpad0",
    }  # fmt: skip
    with pytest.raises(
        DescriptionError, match=r"^could not link camera0\.sound to capsfilter0\.sink: "
    ) as caught:
        build("camera ! meta/x-klv ! fakesink", {})
    assert caught.value.code == "link"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("fakesrc ! a/b,,! nosuch", "link"),
        ("nosuch ! a/b,,! fakesink", "no-such-element"),
        ("fakesrc nosuch=1 num-buffers=x ! fakesink", "no-such-property"),
        ("fakesrc num-buffers=x nosuch=1 ! fakesink", "could-not-set-property"),
        ("fakesink ! fakesrc nosuch=1", "no-such-property"),
        ("fakesink ! fakesrc  a. ! b.", "link"),
        ("a. ! b. fakesink ! fakesrc", "no-such-element"),
        ("nosuch ! fakesink ;", "no-such-element"),
        ("fakesrc ; nosuch", "syntax"),
        ("fakesrc name=", "no-such-element"),
        ("video/x-raw ! x", "no-such-element"),
        ("videotestsrc ! audio/x-raw ! fakesink  nosuch. ! fakesink", "link"),
        ("nosuch. ! fakesink  videotestsrc ! audio/x-raw ! fakesink", "no-such-element"),
        ("( a. ) ! nosuch", "syntax"),
        ("( fakesrc ! a. ) ! fakesink identity name=a", "link"),
        ("fakesrc ! ( a. ! fakesink ) identity name=a", "link"),
        ("nosuch.( )", "empty-bin"),
        ("nosuch.( nosuch2=1 fakesrc )", "no-such-element"),
        ("( nosuch=1 )", "empty-bin"),
        ("identity name=x ! identity name=x", "link"),
        ("identity name=x ! identity name=x ! nosuch", "no-such-element"),
        ("identity @preset=a nosuch=1", "no-such-property"),
        ("identity parent=x", "could-not-set-property"),
    ],
)
def test_the_first_error_is_reported(text: str, expected: str) -> None:
    """As in gst-launch: all elements from left to right, then the links."""
    assert code(text) == expected


def test_a_name_is_found_in_the_last_bin() -> None:
    """r36: the newest of several; equal names in different bins are allowed."""
    text = "( identity name=x ) ( identity name=x ! fakesink ) fakesrc ! x."
    graph = build(text, {})
    first, second = (element for element in graph.elements if element.name == "x")
    assert first.pads["sink"].peer is None
    assert second.pads["sink"].peer is not None
    assert [first.parent, second.parent] == ["bin0", "bin1"]


def test_a_filter_may_be_referenced() -> None:
    """n13: filters are elements made while linking, so a later link finds them by name."""
    assert code("fakesrc ! a/b ! fakesink capsfilter0. ! fakesink") == "link"
    assert code("capsfilter0. ! fakesink fakesrc ! a/b ! fakesink") == "no-such-element"
    assert "t.src_0 -> fakesink1.sink" in links("fakesrc ! a/b ! fakesink tee name=t t. ! fakesink")
