"""Random graphs of core elements deliver every frame exactly once to each sink, in order."""

from dataclasses import dataclass

from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import Frame, Pipeline

LINKS = (
    "queue",
    "queue max-size-buffers=1",
    "queue max-size-buffers=3 max-size-bytes=0",
    "queue min-threshold-buffers=5 max-size-buffers=4",
    "queue max-size-buffers=0 max-size-bytes=20 max-size-time=0",
    "identity",
    "identity silent=false",
    "valve",
    "capsfilter",
    "capsfilter caps=a/b",
    "tee",
    "funnel",
    "concat",
    "input-selector",
    "output-selector",
)
plain = st.lists(st.sampled_from(LINKS[:10]), max_size=4)
single = st.lists(st.sampled_from(LINKS[:15]), max_size=4)


@dataclass(frozen=True)
class Source:
    """A source of so many frames, and what stands behind it."""

    count: int
    links: list[str]

    def text(self, number: int) -> str:
        """Its description; its caps tell its frames from the others'."""
        start = f"fakesrc name=source{number} num-buffers={self.count} sizetype=fixed sizemax={number + 1}"
        return " ! ".join([start, "a/b", *self.links])


sources = st.builds(Source, st.integers(0, 300), single)


def frames_of(pipeline: Pipeline, sinks: int) -> list[list[Frame]]:
    """The frames of each sink, in order of arrival."""
    with pipeline:
        pipeline.play()
        message = pipeline.wait(30)
        assert message is not None
        assert message.error is None
        return [list(pipeline[f"out{number}"]) for number in range(sinks)]


def numbers(frames: list[Frame], size: int) -> list[int]:
    """The numbers of the frames of one source, which all have its size."""
    return [frame.seq for frame in frames if len(frame.data) == size]


SAMPLED = settings(max_examples=25)


@SAMPLED
@given(sources)
def test_chains(source: Source) -> None:
    """One source, any elements in a row, one sink."""
    pipeline = Pipeline.parse(f"{source.text(0)} ! appsink name=out0 max-buffers=0")
    (frames,) = frames_of(pipeline, 1)
    assert [frame.seq for frame in frames] == list(range(source.count))


@SAMPLED
@given(st.integers(0, 300), single, st.lists(plain, min_size=1, max_size=4))
def test_branches(count: int, before: list[str], branches: list[list[str]]) -> None:
    """A tee: each branch gets everything."""
    text = Source(count, before).text(0) + " ! tee name=t"
    for number, links in enumerate(branches):
        text += "  t. ! " + " ! ".join(["queue", *links, f"appsink name=out{number} max-buffers=0"])
    for frames in frames_of(Pipeline.parse(text), len(branches)):
        assert [frame.seq for frame in frames] == list(range(count))


@SAMPLED
@given(st.lists(sources, min_size=1, max_size=4), plain)
def test_joins(inputs: list[Source], after: list[str]) -> None:
    """A funnel: everything of each source, each in its order."""
    text = " ! ".join(["funnel name=f", *after, "appsink name=out0 max-buffers=0"])
    for number, source in enumerate(inputs):
        text += f"  {source.text(number)} ! f."
    (frames,) = frames_of(Pipeline.parse(text), 1)
    assert len(frames) == sum(source.count for source in inputs)
    for number, source in enumerate(inputs):
        assert numbers(frames, number + 1) == list(range(source.count))


@SAMPLED
@given(st.lists(sources, min_size=1, max_size=3), plain)
def test_rows(inputs: list[Source], after: list[str]) -> None:
    """A concat: one source after the other, whole."""
    text = " ! ".join(["concat name=f", *after, "appsink name=out0 max-buffers=0"])
    for number, source in enumerate(inputs):
        text += f"  {source.text(number)} ! f."
    (frames,) = frames_of(Pipeline.parse(text), 1)
    expected = [(number + 1, seq) for number, source in enumerate(inputs) for seq in range(source.count)]
    assert [(len(frame.data), frame.seq) for frame in frames] == expected


@SAMPLED
@given(
    st.integers(0, 200), single, st.lists(plain, min_size=2, max_size=3), plain, st.lists(sources, max_size=2)
)
def test_diamonds(
    count: int, before: list[str], branches: list[list[str]], after: list[str], others: list[Source]
) -> None:
    """Tee, queues, funnel, and other sources into the same funnel: each frame comes once for each branch."""
    text = " ! ".join([Source(count, before).text(0), "tee name=t"])
    text += "  funnel name=f ! " + " ! ".join([*after, "appsink name=out0 max-buffers=0"])
    for links in branches:
        text += "  t. ! " + " ! ".join(["queue", *links, "f."])
    for number, source in enumerate(others, 1):
        text += f"  {source.text(number)} ! queue ! f."
    (frames,) = frames_of(Pipeline.parse(text), 1)
    own = numbers(frames, 1)
    assert sorted(own) == sorted(list(range(count)) * len(branches))
    for number, source in enumerate(others, 1):
        assert numbers(frames, number + 1) == list(range(source.count))
