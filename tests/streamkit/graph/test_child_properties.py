"""Properties of bins and of their children."""

import re

import pytest

from streamkit.errors import DescriptionError
from streamkit.graph.build import build


@pytest.mark.parametrize(
    ("text", "name", "settings"),
    [
        ("bin.( s::num-buffers=3 fakesrc name=s )", "s", {"num-buffers": 3}),
        ("( fakesrc0::num_buffers=3 fakesrc )", "fakesrc0", {"num-buffers": 3}),
        ("( b::s::num-buffers=3 ( name=b fakesrc name=s ) )", "s", {"num-buffers": 3}),
        ("( s::num-buffers=1 s::num-buffers=2 fakesrc name=s num-buffers=3 )", "s", {"num-buffers": 2}),
        ("( capsfilter0::caps=a/b fakesrc ! a/c ! identity )", "capsfilter0", {"caps": "a/b"}),
    ],
)
def test_brackets_set_properties_of_children(text: str, name: str, settings: dict[str, object]) -> None:
    """b17: at any depth, over what the child's own text says, and on what links bring later."""
    assert build(text, {}).element(name).properties_set() == settings


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [
        ("( s::nosuch=3 fakesrc name=s )", "could-not-set-property", "fakesrc has no property 'nosuch'"),
        (
            "( s::num-buffers=x fakesrc name=s )",
            "could-not-set-property",
            "s: property num-buffers cannot be 'x'",
        ),
        (
            "( message-forward=maybe fakesrc )",
            "could-not-set-property",
            "bin0: property message-forward cannot",
        ),
        ("( nosuch=3 fakesrc )", "no-such-property", "bin has no property 'nosuch'"),
        (
            "pipeline.( delay=-x fakesrc )",
            "could-not-set-property",
            "pipeline0: property delay cannot be '-x'",
        ),
        ("( delay=1 fakesrc )", "no-such-property", "bin has no property 'delay'"),
    ],
)
def test_invalid_properties_of_bins(text: str, code: str, message: str) -> None:
    """b06, b07, b18, b20: gst-launch's codes."""
    with pytest.raises(DescriptionError, match=f"^{re.escape(message)}") as caught:
        build(text, {})
    assert caught.value.code == code


@pytest.mark.parametrize("text", ["( x::y=3 fakesrc )", "( s::x::y=3 fakesrc name=s )", "bin x::y=3 fakesrc"])
def test_a_missing_child_is_a_warning(text: str) -> None:
    """b19: nothing is set."""
    assert [code for code, _ in build(text, {}).warnings] == ["no-such-child"]


def test_a_bins_own_properties_are_kept_and_change_nothing() -> None:
    """They are shown, with a warning that they have no effect."""
    graph = build("pipeline.( name=a message-forward=true latency=5 name=b fakesrc )", {})
    assert [(group.name, group.properties_set()) for group in graph.bins] == [
        ("b", {"message-forward": True, "latency": 5}),
    ]  # fmt: skip
    assert [code for code, _ in graph.warnings] == ["no-effect", "no-effect"]
    assert graph.elements[0].parent == "b"


def test_an_empty_bin_may_stand_like_an_element() -> None:
    """n05-n07: legal, and there is nothing to link."""
    graph = build("bin name=b fakesrc ! fakesink pipeline", {})
    assert [(group.name, group.factory) for group in graph.bins] == [("b", "bin"), ("pipeline0", "pipeline")]
    for text in ("pipeline ! fakesink", "fakesrc ! bin", "( name=b fakesrc ) b. ! fakesink"):
        with pytest.raises(DescriptionError) as caught:
            build(text, {})
        assert caught.value.code == "link"
