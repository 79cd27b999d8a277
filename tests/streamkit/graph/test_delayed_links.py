"""Links that wait for pads that the stream adds."""

from collections.abc import Callable, Iterator

import pytest

from streamkit import (
    ANY,
    Caps,
    Direction,
    Frame,
    Message,
    MessageKind,
    PadTemplate,
    Pipeline,
    Presence,
    Property,
    Source,
)
from streamkit.errors import DescriptionError, ElementFailure
from streamkit.graph.build import build

Register = Callable[..., None]


class Demuxer(Source):
    """Finds out in its stream which pads it has."""

    templates = (
        PadTemplate("video_%u", Direction.SRC, Caps("video/x-raw"), Presence.SOMETIMES),
        PadTemplate("data_%u", Direction.SRC, Caps("meta/x-klv"), Presence.SOMETIMES),
    )
    pads_found: str = Property("video_0", doc="Names of the pads of the stream.")

    def frames(self) -> Iterator[tuple[str, Frame]]:
        """Two frames on each pad."""
        found = self.pads_found.split("+")
        for name in found:
            self.add_pad(f"{name.partition('_')[0]}_%u", name)
        self.no_more_pads()
        for number in range(2):
            for name in found:
                caps = Caps("video/x-raw, format=GRAY8, width=1, height=1, framerate=1/1")
                yield name, Frame(b"x", caps if name.startswith("video") else Caps("meta/x-klv"), number)


@pytest.fixture
def demuxer(register: Register) -> None:
    """An element `demux` whose pads come with the stream."""
    register(demux=Demuxer)


def run(text: str) -> tuple[dict[str, int], list[str]]:
    """How many frames each appsink got, and the codes of the warnings."""
    reported: list[Message] = []
    with Pipeline.parse(text) as pipeline:
        sinks = [element.name for element in pipeline.graph.elements if element.factory == "appsink"]
        pipeline.bus.watch(reported.append)
        pipeline.play()
        got = {name: len(list(pipeline[name])) for name in sinks}  # type: ignore[call-overload]
    return got, [
        str(message.fields.get("code")) for message in reported if message.kind is MessageKind.WARNING
    ]


@pytest.mark.usefixtures("demuxer")
@pytest.mark.parametrize(
    ("text", "got"),
    [
        ("demux ! appsink", {"appsink0": 2}),
        ("demux ! video/x-raw ! appsink", {"appsink0": 2}),
        ("demux name=d d.video_0 ! appsink", {"appsink0": 2}),
        ("demux pads-found=data_0+video_3 ! video/x-raw ! appsink", {"appsink0": 2}),
        ("demux pads-found=data_0+video_3 name=d d.video_3 ! appsink", {"appsink0": 2}),
        (
            "demux pads-found=data_0+video_0 name=d d.video_0 ! appsink name=v d.data_0 ! appsink name=k",
            {"v": 2, "k": 2},
        ),
        ("demux pads-found=video_0+video_1 name=d d. ! appsink d. ! appsink", {"appsink0": 2, "appsink1": 2}),
        ("demux pads-found=video_0+video_1+data_0 : funnel ! appsink", {"appsink0": 6}),
        ("demux pads-found=video_0+video_1+data_0 : video/x-raw ! funnel ! appsink", {"appsink0": 4}),
    ],
)
def test_the_link_is_made_when_the_pad_is_added(text: str, got: dict[str, int]) -> None:
    """By name and filter; `:` links every new pad, `!` the first that fits."""
    assert run(text) == (got, [])


@pytest.mark.usefixtures("demuxer")
def test_a_pad_that_never_comes_is_a_warning() -> None:
    """Code `delayed-link`, once no more pads follow; the waiting sink ends."""
    text = "demux name=d d.video_0 ! appsink name=v d.video_7 ! appsink name=w"
    assert run(text) == ({"v": 2, "w": 0}, ["delayed-link"])


@pytest.mark.usefixtures("demuxer")
def test_a_stream_that_feeds_nothing_is_an_error() -> None:
    """For example without a decoder: `not-linked` in gst-launch."""
    text = "demux name=d pads-found=data_0 ! video/x-raw ! fakesink"
    with (
        Pipeline.parse(text) as pipeline,
        pytest.raises(ElementFailure, match=r"none of its pads is linked: .* it has data_0; insert an"),
    ):
        pipeline.run(timeout_s=20)


@pytest.mark.parametrize(("knows_caps", "kind"), [(True, " (video/x-h264)"), (False, "")])
def test_a_forgotten_decoder_is_one_error(register: Callable[..., None], knows_caps: bool, kind: str) -> None:
    """It says what to put where; a live source knows the codec later; no second error repeats it."""

    class Coded(Source):
        templates = (PadTemplate("src", Direction.SRC, Caps("video/x-h264"), Presence.SOMETIMES),)

        def frames(self) -> Iterator[Frame]:
            pad = self.add_pad("src")
            pad.caps = Caps("video/x-h264") if knows_caps else None
            self.no_more_pads()
            yield Frame(b"", Caps("video/x-h264"))

    register(coded=Coded)
    with Pipeline.parse("coded ! video/x-raw ! fakesink") as pipeline:
        faults: list[str] = []
        kinds = (MessageKind.ERROR, MessageKind.WARNING)
        pipeline.bus.watch(lambda message: faults.append(message.text) if message.kind in kinds else None)
        with pytest.raises(ElementFailure):
            pipeline.run(timeout_s=20)
    wanted = f"coded0: gives coded packets{kind}, which fakesink0 does not take: "
    assert faults == [wanted + "put decode between, coded0 ! decode ! fakesink0"]


@pytest.mark.usefixtures("demuxer")
def test_the_warning_names_the_pads_there_are() -> None:
    """Once, with its element beside it: what was mistyped or left out shows by what is there."""
    texts: list[str] = []
    with Pipeline.parse("demux name=d d.video_0 ! fakesink d.video_7 ! fakesink") as pipeline:
        pipeline.bus.watch(lambda message: texts.append(message.text))
        pipeline.run(timeout_s=20)
    reported = [text for text in texts if "no pad" in text]
    assert reported == ["the stream has no pad for d.video_7 ! fakesink1; it has video_0"]


@pytest.mark.usefixtures("demuxer")
def test_waiting_elements_are_reported() -> None:
    """The graph lists its delayed links; a filter is not made before its time."""
    graph = build("demux name=d d.video_0 ! a/b ! fakesink  d. : fakesink", {})
    assert [link.description for link in graph.delayed_links] == ["d.video_0 ! fakesink0", "d. ! fakesink1"]
    assert [element.name for element in graph.elements] == ["d", "fakesink0", "fakesink1"]


@pytest.mark.usefixtures("demuxer")
def test_only_src_pads_are_waited_for() -> None:
    """A missing sink pad is an error at once."""
    for text in ("fakesrc ! demux", "fakesrc name=a a.video_0 ! fakesink"):
        with pytest.raises(DescriptionError) as caught:
            build(text, {})
        assert caught.value.code == "link"


@pytest.mark.usefixtures("demuxer")
@pytest.mark.parametrize(
    ("text", "message", "column"),
    [
        ("demux name=d d.vidoe_0 ! fakesink", "d has no pad 'vidoe_0'; did you mean \"video_%u\"?", 16),
        ("demux name=d d.video_0 ! fakesink name=f d.data_0 ! f.snk", "f has no pad 'snk'; did you mean", 55),
    ],
)
def test_a_pad_that_can_never_come_is_an_error_at_once(text: str, message: str, column: int) -> None:
    """A warning at the end would blame the stream for a name that is misspelt."""
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert message in str(caught.value)
    assert caught.value.place.column == column


class Listed(Source):
    """A pad that is named in the text is made at once."""

    src = ANY
    templates = (PadTemplate("telemetry", Direction.SRC, ANY, Presence.SOMETIMES),)


def test_a_sometimes_pad_of_a_fixed_name_is_linked_at_once(register: Register) -> None:
    """The element then knows what is wanted of it; an unnamed link takes the pad that is there."""
    register(listed=Listed)
    graph = build("listed name=l ! fakesink  l.telemetry ! fakesink  l. ! fakesink", {})
    assert [f"{src.path} -> {sink.path}" for src, sink in graph.links()] == [
        "l.src -> fakesink0.sink", "l.telemetry -> fakesink1.sink",
    ]  # fmt: skip
    assert len(graph.delayed_links) == 1
