"""Hints for GStreamer's names."""

import pytest

from streamkit import DescriptionError
from streamkit.element.gstreamer_names import ANYWHERE, PROPERTIES, property_hint
from streamkit.element.registry import element_class
from streamkit.graph.build import build


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("rtspsrc uri=rtsp://a ! fakesink", "here: location=URL"),
        ("rtspsrc location=rtsp://a protocols=tcp ! fakesink", "here: transport=tcp or transport=udp"),
        ("videotestsrc ! encode speed-preset=fast ! fakesink", "here: preset=WORD"),
        ("videotestsrc ! encode tune=zerolatency ! fakesink", "here: live=true for zerolatency"),
        ("videotestsrc ! videofilesink max-size-time=9", "here: encode ! packetsink, which has it"),
        ("filesrc location=a num-buffers=3 ! fakesink", "here: stop-s=SECONDS, or identity eos-after=NUMBER"),
        ("videotestsrc ! videoconvert sync=false ! fakesink", "here: sync= of a sink, or identity sync=true"),
        ("dronetestsrc width=640 ! fakesink", "here: a caps filter behind it: video/x-raw with width"),
        (
            "videotestsrc ! videoscale width=64 ! fakesink",
            "here: a caps filter behind it: video/x-raw with width",
        ),
        ("compositor name=c sink_1::xpos=320 ! fakesink", "here: nothing; inputs are side by side"),
    ],
)
def test_a_property_of_gstreamer_gets_a_hint(text: str, hint: str) -> None:
    """It names what does its work here."""
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert caught.value.hint.startswith(hint)


def test_hints_are_for_properties_that_are_missing() -> None:
    """No element has a property of this name; each named by a hint is there."""
    for name, properties in PROPERTIES.items():
        known = element_class(name)
        for spelling, words in properties.items():
            assert known.declaration_of(spelling) is None, (name, spelling)
            named, equals, _ = words.partition("=")
            assert not equals or known.declaration_of(named) is not None, words
    assert property_hint("nothing", "nothing") == ""
    assert all(property_hint("nothing", name) for name in ANYWHERE)


def test_a_format_in_small_letters_gets_a_hint() -> None:
    """Formats are written in capitals, as in GStreamer."""
    with pytest.raises(DescriptionError, match=r"; write format=RGB$"):
        build("videotestsrc ! video/x-raw, format=rgb ! fakesink", {})
    with pytest.raises(DescriptionError, match="disagree on format") as caught:
        build("videotestsrc ! video/x-raw, format=xyz ! fakesink", {})
    assert "write" not in str(caught.value)
