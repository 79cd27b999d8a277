"""Negotiation before streaming, and inserted converters."""

from collections.abc import Callable

import pytest

from streamkit import Frame, Pipeline, Sink, Source, Transform
from streamkit.errors import DescriptionError, StateError
from streamkit.graph.build import build

Register = Callable[..., None]


class Camera(Source):
    """Colour pictures."""

    src = "video/x-raw, format={ BGR, RGB }, width=[ 1, 640 ]"


class Screen(Sink):
    """Grey pictures."""

    sink = "video/x-raw, format=GRAY8"


class Wide(Sink):
    """Wide colour pictures."""

    sink = "video/x-raw, format=BGR, width=[ 1000, 2000 ]"


class Convert(Transform):
    """Any format."""

    sink = "video/x-raw, format={ GRAY8, BGR, RGB }"
    src = "video/x-raw, format={ BGR, GRAY8 }"

    def transform(self, frame: Frame) -> Frame:
        return frame


def test_pads_without_common_caps_are_refused(register: Register) -> None:
    """Both pads, both caps and the field in conflict, at the place of the link."""
    register(camera=Camera, wide=Wide)
    text = "camera !\n  identity ! wide"
    with pytest.raises(
        DescriptionError,
        match=r"^could not link identity0.src to wide0.sink: they disagree on width: identity0.src offers "
        r".*width=\(int\)\[ 1, 640 \]; wide0.sink takes .*width=\(int\)\[ 1000, 2000 \]; "
        r"put videoscale between$",
    ) as caught:
        build(text, {})
    assert caught.value.code == "link"
    assert caught.value.pointed(text).split("\n")[1:] == ["      identity ! wide", "               ^"]


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("camera ! coded", "put encode between"),
        ("camera ! queue ! coded", "put encode between"),
        ("camera ! video/x-h264 ! fakesink", "put encode between"),
        ("camera ! video/x-av1 ! fakesink", "put encode between"),
        ("camera ! video/raw ! fakesink", 'video/raw: did you mean "video/x-raw"'),
        ("camera ! video/x-raw-yuv ! fakesink", 'video/x-raw-yuv: did you mean "video/x-raw"'),
        ("camera ! packer ! screen", "put decode between"),
        ("camera ! packer ! identity ! packer", "the video is encoded before packer1: leave packer1 out"),
        (
            "camera ! packer ! unpacker ! unpacker",
            "the video is decoded before unpacker1: leave unpacker1 out",
        ),
    ],
)
def test_raw_video_where_coded_belongs_has_a_remedy(register: Register, text: str, remedy: str) -> None:
    """In a few words: the media types, and what to add or leave out."""
    coded = "; ".join(f"video/x-h26{number}" for number in range(9))
    register(
        camera=Camera,
        screen=Screen,
        coded=type("Coded", (Sink,), {"sink": coded, "__doc__": "Takes packets."}),
        packer=type("Packer", (Transform,), {"sink": "video/x-raw", "src": coded, "__doc__": "Encodes."}),
        unpacker=type("Unpacker", (Transform,), {"sink": coded, "src": "video/x-raw", "__doc__": "Decodes."}),
    )
    with pytest.raises(DescriptionError, match=f"they disagree on media type: .*; {remedy}") as caught:
        build(f"{text} ! fakesink" if "unpacker" in text else text, {})
    assert len(str(caught.value)) < 250


def test_a_filter_that_no_caps_can_pass_is_refused() -> None:
    """f50: the check is made while building, not when the first frame comes."""
    with pytest.raises(DescriptionError, match="disagree on media type"):
        build("fakesrc ! a/b ! identity ! c/d ! fakesink", {})


def test_a_converter_is_inserted_where_raw_formats_differ(register: Register) -> None:
    """With a warning, in the bin of the source."""
    register(camera=Camera, screen=Screen, videoconvert=Convert)
    graph = build("( name=b camera ) ! screen", {})
    assert {f"{src.path} -> {sink.path}" for src, sink in graph.links()} == {
        "camera0.src -> videoconvert0.sink", "videoconvert0.src -> screen0.sink",
    }  # fmt: skip
    assert [(e.name, e.factory, e.parent) for e in graph.inserted] == [("videoconvert0", "videoconvert", "b")]
    ((code, text),) = graph.warnings
    assert code == "converter-inserted"
    assert text.startswith("videoconvert0 was inserted between camera0.src and screen0.sink: ")


class Grey(Transform):
    """Grey pictures in and out."""

    sink = src = "video/x-raw, format=GRAY8"

    def transform(self, frame: Frame) -> Frame:
        return frame


class Colour(Sink):
    """Colour pictures."""

    sink = "video/x-raw, format=BGR"


@pytest.mark.parametrize(
    ("text", "converters"),
    [
        ("t. ! queue ! grey ! screen  t. ! queue ! colour", 1),
        ("t. ! queue ! grey ! colour  t. ! queue ! colour", 2),
        ("t. ! queue ! grey ! colour  t. ! queue ! grey ! colour", 3),
    ],
)
def test_each_conflict_behind_a_tee_is_found(register: Register, text: str, converters: int) -> None:
    """One does not hide another: a pad that nothing can be offered to is judged by its own caps."""
    register(camera=Camera, grey=Grey, colour=Colour, screen=Screen, videoconvert=Convert)
    graph = build(f"camera ! tee name=t  {text}", {})
    assert len(graph.inserted) == converters


def test_no_converter_is_inserted_between_pads_that_agree(register: Register) -> None:
    """Common formats need none."""
    register(camera=Camera, videoconvert=Convert)
    graph = build("camera ! video/x-raw, format=BGR ! fakesink", {})
    assert not graph.inserted
    assert not graph.warnings


def test_no_scaler_is_inserted(register: Register) -> None:
    """Other sizes are an error."""
    register(camera=Camera, wide=Wide, videoconvert=Convert)
    with pytest.raises(DescriptionError, match="disagree on width"):
        build("camera ! wide", {})


def test_a_converter_that_is_broken_is_an_error_of_this_description(register: Register) -> None:
    """The plugin is named at the link that needs it; what needs none is built."""
    register(camera=Camera, screen=Screen, videoconvert="no_such_module:Thing")
    with pytest.raises(DescriptionError, match=r"element 'videoconvert' .* cannot be loaded") as caught:
        build("camera ! screen", {})
    assert (caught.value.code, caught.value.place.column) == ("plugin-broken", 8)
    assert build("camera ! fakesink", {}).elements


def test_a_loop_builds_but_does_not_start() -> None:
    """As in gst-launch there is a warning; frames would never leave it."""
    text = "identity name=a ! identity name=b  b. ! a."
    assert [code for code, _ in build(text, {}).warnings] == ["loop"]
    with Pipeline.parse(text) as pipeline, pytest.raises(StateError, match="the links form a loop"):
        pipeline.play()


def test_a_preference_travels_up_through_transforms(register: Register) -> None:
    """A transform that takes either format offers its source the one that its sink prefers."""

    class Either(Transform):
        sink = src = "video/x-raw, format={ GRAY8, I420 }"

        def transform(self, frame: Frame) -> Frame:
            return frame

    class Colour(Sink):
        sink = "video/x-raw, format={ I420, GRAY8 }"

    register(either=Either, colour=Colour)
    graph = Pipeline.parse("fakesrc ! either name=e ! colour").graph
    assert str(graph.element("e").pads["sink"].query_caps()) == "video/x-raw, format=(string){ I420, GRAY8 }"
