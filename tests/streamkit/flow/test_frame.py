"""Frames: read-only data that is shared, and a copy only where somebody else looks."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from streamkit import Caps, Capture, Frame, FrameFlags, Pipeline, Pose, Registration, Source, Transform
from streamkit.testing import Harness

GREY = Caps("video/x-raw, format=GRAY8, width=4, height=2")
Register = Callable[..., None]


def grey_frame(seq: int = 0) -> Frame:
    """A black picture."""
    return Frame(np.zeros((2, 4), np.uint8), GREY, seq=seq)


class GreySource(Source):
    """Three frames whose arrays nobody else holds."""

    src = "video/x-raw, format=GRAY8"

    def negotiate(self, allowed: Caps) -> Caps:
        return GREY

    def frames(self) -> Iterator[Frame]:
        for seq in range(3):
            yield Frame(np.zeros((2, 4), np.uint8), GREY, seq=seq, arrival_ns=1)


class Brighten(Transform):
    """Writes into each frame; notes whether it was the same array."""

    sink = src = "video/x-raw, format=GRAY8"

    def start(self) -> None:
        self.in_place: list[bool] = []

    def transform(self, frame: Frame) -> Frame:
        address = frame.data.__array_interface__["data"][0]
        frame = frame.writable()
        self.in_place.append(frame.data.__array_interface__["data"][0] == address)
        frame.data[:] += 1
        return frame


def test_an_array_in_a_frame_is_read_only() -> None:
    """Whoever shares a frame can trust that nobody writes into it."""
    frame = grey_frame()
    with pytest.raises(ValueError, match="read-only"):
        frame.data[0, 0] = 1


def test_a_frame_is_frozen() -> None:
    """Attributes change only by making another frame."""
    frame = grey_frame()
    with pytest.raises(AttributeError):
        frame.seq = 3  # type: ignore[misc]
    changed = frame.replace(seq=3, flags=FrameFlags.CORRUPT)
    assert (changed.seq, changed.flags, frame.seq, frame.flags) == (3, FrameFlags.CORRUPT, 0, 0)
    assert changed.data is frame.data


def test_metadata_is_found_by_type() -> None:
    """Each item lies under its type; a later one of the type replaces it; the first frame stays as it was."""
    frame = grey_frame()
    pose = Pose(47.0, 8.0)
    registration = Registration(np.eye(3), np.eye(3))
    richer = frame.attach(pose, registration)
    assert richer.get(Pose) is pose
    assert richer.get(Registration) is registration
    assert richer.attach(Pose(1.0, 2.0)).get(Pose) == Pose(1.0, 2.0)
    assert richer.get(Pose) is pose
    assert frame.get(Pose) is None


def test_an_item_can_lie_under_a_protocol() -> None:
    """`attach_as` names the type to ask for."""
    assert grey_frame().attach_as(Iterator, iter(())).get(Iterator) is not None  # type: ignore[type-abstract]


class WriteAndKeep(Transform):
    """Keeps each frame and writes into what `writable` gives."""

    sink = src = "video/x-raw, format=GRAY8"

    def start(self) -> None:
        self.kept: list[Frame] = []

    def transform(self, frame: Frame) -> Frame:
        self.kept.append(frame)
        changed = frame.writable()
        changed.data[:] = 9
        return changed


def test_writing_copies_while_somebody_else_holds_the_frame(register: Register) -> None:
    """One more holder, be it the element itself, and the writer gets a copy; also behind a queue."""
    register(greysource=GreySource, writeandkeep=WriteAndKeep)
    text = "greysource ! writeandkeep name=a ! queue ! writeandkeep name=b ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        assert [frame.data.max() for frame in pipeline["a"].kept] == [0, 0, 0]
        assert [frame.data.max() for frame in frames] == [9, 9, 9]
        assert [frame.seq for frame in frames] == [0, 1, 2]


def test_a_copy_of_a_frame_is_writable_once() -> None:
    """The copy may be written; as soon as it goes into another frame it is read-only again."""
    shared = grey_frame()
    holders = [shared, shared]
    writable = shared.writable()
    writable.data[0, 0] = 5
    assert holders[0].data[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        writable.replace(seq=1).data[0, 0] = 6


def test_a_writer_never_changes_the_frame_it_was_given(register: Register) -> None:
    """Through a chain of transforms, a queue and into an appsink each writer has its own copy."""
    register(greysource=GreySource, brighten=Brighten)
    text = "greysource ! brighten name=a ! brighten name=b ! queue ! brighten name=c ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        assert [frame.data.max() for frame in frames] == [3, 3, 3]
        assert pipeline["a"].in_place == [False] * 3
        assert pipeline["c"].in_place == [False] * 3


def test_branches_of_a_tee_do_not_see_each_others_writing(register: Register) -> None:
    """A frame that two branches share is copied by the one that writes."""
    register(greysource=GreySource, brighten=Brighten)
    text = """greysource ! tee name=t  t. ! brighten ! brighten ! appsink name=two
              t. ! brighten ! appsink name=one  t. ! appsink name=none"""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        brightest = [{int(f.data.max()) for f in pipeline[name]} for name in ("none", "one", "two")]
    assert brightest == [{0}, {1}, {2}]


def test_a_view_is_copied() -> None:
    """An array that looks into another one is never written in place: its owner would change too."""
    whole = np.zeros((4, 4), np.uint8)

    class View(Transform):
        """Writes into a view."""

        sink = src = "ANY"

        def transform(self, frame: Frame) -> Frame:
            frame = Frame(whole[:2], GREY).writable()
            frame.data[:] = 7
            return frame

    with Harness(View()) as harness:
        (out,) = harness.push(grey_frame())
    assert out.data.max() == 7
    assert whole.max() == 0


def test_a_frame_names_itself() -> None:
    """Messages say which frame: its number, its time and, after a discontinuity, its epoch."""
    caps = Caps("a/b")
    assert Frame(b"", caps, seq=12, pts=480_000_000).describe() == "frame seq=12 pts=0.480 s"
    assert Frame(b"", caps, seq=3, epoch=2).describe() == "frame seq=3 epoch=2"


def test_time_of_capture_carries_its_origin() -> None:
    """A UTC time says where it is from."""
    frame = Frame(b"", Caps("a/b"), capture=Capture(1_763_690_000_000_000_000, "rtcp"))
    assert frame.capture is not None
    assert frame.capture.origin == "rtcp"
