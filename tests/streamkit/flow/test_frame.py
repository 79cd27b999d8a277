"""Frames: shared read-only data, and writable copies."""

import copy
import inspect
import pickle
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


@pytest.mark.parametrize("metadata", [(), (Registration(np.eye(3), np.eye(3)),)])
def test_a_frame_goes_to_another_process(metadata: tuple[object, ...]) -> None:
    """As to those of multiprocessing.Pool, with or without metadata; it stays read-only."""
    frame = grey_frame(7).attach(*metadata) if metadata else grey_frame(7)
    for copied in (pickle.loads(pickle.dumps(frame)), copy.deepcopy(frame)):
        np.testing.assert_array_equal(copied.data, frame.data)
        assert (copied.seq, copied.caps, len(copied.metadata)) == (7, GREY, len(metadata))
        assert not copied.data.flags.writeable


class GreySource(Source):
    """Three frames of grey video."""

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
    """Frames are shared."""
    frame = grey_frame()
    with pytest.raises(ValueError, match="read-only"):
        frame.data[0, 0] = 1


def test_a_frame_is_frozen() -> None:
    """Attributes cannot be set."""
    frame = grey_frame()
    with pytest.raises(AttributeError):
        frame.seq = 3  # type: ignore[misc]
    changed = frame.replace(seq=3, flags=FrameFlags.CORRUPT)
    assert (changed.seq, changed.flags, frame.seq, frame.flags) == (3, FrameFlags.CORRUPT, 0, 0)
    assert changed.data is frame.data


def test_metadata_is_found_by_type() -> None:
    """A later item of a type replaces the earlier one in the new frame only."""
    frame = grey_frame()
    pose = Pose(47.0, 8.0)
    registration = Registration(np.eye(3), np.eye(3))
    richer = frame.attach(pose, registration)
    assert richer.get(Pose) is pose
    assert richer.get(Registration) is registration
    assert richer.attach(Pose(1.0, 2.0)).get(Pose) == Pose(1.0, 2.0)
    assert richer.get(Pose) is pose
    assert frame.get(Pose) is None


@pytest.mark.parametrize("item", [{"mean": 1.0}, {Capture: 1}, [1], 5, "text", np.zeros(3), np.float64(1)])
def test_what_anybody_may_attach_is_no_metadata(item: object) -> None:
    """Entries would not be found, and two elements that attach one would replace each other's."""
    with pytest.raises(
        TypeError, match=f"must be a class of its own, as a dataclass, got {type(item).__name__}"
    ):
        grey_frame().attach(item)


def test_metadata_is_replaced_by_a_mapping_only() -> None:
    """Where it is given: the next `attach` would fail, in another element."""
    with pytest.raises(TypeError, match=r"must be a mapping by type, got Capture; add it by frame.attach"):
        grey_frame().replace(metadata=Capture(1, "file"))
    assert grey_frame().replace(metadata={int: 5}).get(int) == 5


def test_an_item_can_be_attached_under_a_protocol() -> None:
    """With `attach_as`."""
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


def test_writable_returns_a_copy(register: Register) -> None:
    """Also behind a queue."""
    register(greysource=GreySource, writeandkeep=WriteAndKeep)
    text = "greysource ! writeandkeep name=a ! queue ! writeandkeep name=b ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        assert [frame.data.max() for frame in pipeline["a"].kept] == [0, 0, 0]
        assert [frame.data.max() for frame in frames] == [9, 9, 9]
        assert [frame.seq for frame in frames] == [0, 1, 2]


def test_a_copy_of_a_frame_is_writable_once() -> None:
    """In another frame it is read-only again."""
    shared = grey_frame()
    holders = [shared, shared]
    writable = shared.writable()
    writable.data[0, 0] = 5
    assert holders[0].data[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        writable.replace(seq=1).data[0, 0] = 6


def test_a_writer_does_not_change_its_input(register: Register) -> None:
    """Through transforms, a queue and an appsink."""
    register(greysource=GreySource, brighten=Brighten)
    text = "greysource ! brighten name=a ! brighten name=b ! queue ! brighten name=c ! appsink name=out"
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        frames = list(pipeline["out"])
        assert [frame.data.max() for frame in frames] == [3, 3, 3]
        assert pipeline["a"].in_place == [False] * 3
        assert pipeline["c"].in_place == [False] * 3


def test_branches_of_a_tee_do_not_see_each_others_writing(register: Register) -> None:
    """The branch that writes gets a copy."""
    register(greysource=GreySource, brighten=Brighten)
    text = """greysource ! tee name=t  t. ! brighten ! brighten ! appsink name=two
              t. ! brighten ! appsink name=one  t. ! appsink name=none"""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        brightest = [{int(f.data.max()) for f in pipeline[name]} for name in ("none", "one", "two")]
    assert brightest == [{0}, {1}, {2}]


def test_a_view_is_copied() -> None:
    """The owner of the array is not changed."""
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


def test_describe() -> None:
    """Number, time and, after a discontinuity, epoch."""
    caps = Caps("a/b")
    assert Frame(b"", caps, seq=12, pts=480_000_000).describe() == "frame seq=12 pts=0.480 s"
    assert Frame(b"", caps, seq=3, epoch=2).describe() == "frame seq=3 epoch=2"


def test_a_frame_is_shown_in_one_line() -> None:
    """A notebook shows what it is; pixels and metadata would fill the screen."""
    frame = Frame(np.zeros((2, 4), np.uint8), Caps("video/x-raw, width=4"), pts=40_000_000, seq=1)
    assert repr(frame) == "<frame seq=1 pts=0.040 s: video/x-raw, width=(int)4>"
    assert repr(frame.attach(Registration(np.eye(3), np.eye(3)))).endswith("(int)4; Registration>")


def test_capture_has_an_origin() -> None:
    """A UTC time and where it is from."""
    frame = Frame(b"", Caps("a/b"), capture=Capture(1_763_690_000_000_000_000, "rtcp"))
    assert frame.capture is not None
    assert frame.capture.origin == "rtcp"


def test_help_shows_a_frame() -> None:
    """`help(Frame)` and a notebook's `Frame?` resolve the annotations, which msgspec needs at run time."""
    assert list(inspect.signature(Frame).parameters)[:3] == ["data", "caps", "pts"]
