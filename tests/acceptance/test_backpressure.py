"""Backpressure: a slow sink holds memory flat; frames are shared, never torn, copied only where needed."""

import gc
import resource
import threading
import weakref
from collections.abc import Callable, Iterator

import numpy as np

from streamkit import Caps, Frame, Pipeline, Property, Sink, Source, Transform
from streamkit.flow.events import Flushing

Register = Callable[..., None]
UHD = Caps("video/x-raw, format=BGR, width=3840, height=2160, framerate=30/1")
HD = Caps("video/x-raw, format=BGR, width=1920, height=1080, framerate=30/1")
MEGABYTE = 1 << 20


def peak_memory() -> int:
    """The most bytes this process has held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


class UhdSource(Source):
    """Pictures of 24 MB, each its own; knows how many are alive."""

    src = UHD
    alive = 0
    most = 0

    def frames(self) -> Iterator[Frame]:
        """One new array a frame, without end."""
        for number in range(10_000):
            data = np.empty((2160, 3840, 3), np.uint8)
            data[0, 0] = number % 256
            type(self).alive += 1
            type(self).most = max(self.alive, self.most)
            weakref.finalize(data, self._gone)
            frame = Frame(data, UHD, pts=number * 33_333_333)
            del data
            yield frame
            del frame

    @classmethod
    def _gone(cls) -> None:
        cls.alive -= 1


class Sleeper(Sink):
    """Takes a frame, then sleeps; tells when it has taken enough."""

    sink = "ANY"
    enough = 60

    def start(self) -> None:
        """Begins."""
        self.count = 0
        self.done = threading.Event()

    def render(self, frame: Frame) -> None:
        """Sleeps."""
        if self.stopping.wait(0.01):
            raise Flushing(self.name)
        self.count += 1
        if self.count >= self.enough:
            self.done.set()


def test_a_slow_sink_holds_memory_flat(register: Register) -> None:
    """A 4K source into a sink that sleeps: no more pictures live than the queues may hold."""
    register(uhdsource=UhdSource, sleeper=Sleeper)
    before = peak_memory()
    UhdSource.alive = UhdSource.most = 0
    with Pipeline.parse("uhdsource ! queue max-size-bytes=60000000 ! queue ! sleeper name=s") as pipeline:
        pipeline.play()
        assert pipeline["s"].done.wait(60)
        levels = {row.element: row.queue for row in pipeline.statistics() if row.queue is not None}
    gc.collect()
    assert UhdSource.alive == 0
    # Three in the first queue (full at 60 MB), one in the second (full at 10 MB), one at each of two
    # hand-overs, one with the sink, one with the source.
    assert UhdSource.most <= 8
    assert max(level.max_buffers for level in levels.values()) <= 3
    assert peak_memory() - before < 12 * 24 * MEGABYTE


class Shared(Source):
    """Frames that share a few pictures, each filled with one value."""

    src = HD
    num_buffers: int = Property(0, doc="Frames.")

    def start(self) -> None:
        """Draws the pictures."""
        self.pictures = [np.full((1080, 1920, 3), value, np.uint8) for value in range(8)]

    def frames(self) -> Iterator[Frame]:
        """Frames that share a picture have the same number, modulo 8."""
        for number in range(self.num_buffers):
            yield Frame(self.pictures[number % 8], HD, pts=number * 33_333_333)


class Writer(Transform):
    """Changes a corner of every so many frames, in a copy where the picture is shared."""

    sink = src = HD
    every: int = Property(100, doc="Frames between two that are changed.")

    def start(self) -> None:
        """Has copied nothing."""
        self.copies = self.changed = 0

    def is_due(self, frame: Frame) -> bool:
        """Whether to change it."""
        return frame.seq % self.every == 0

    def transform(self, frame: Frame) -> Frame:
        """Writes 255 into the corner."""
        if not self.is_due(frame):
            return frame
        picture = frame.data.__array_interface__["data"][0]
        mine = frame.writable()
        self.copies += mine.data.__array_interface__["data"][0] != picture
        mine.data[:4, :4] = 255
        self.changed += 1
        return mine


class Checks(Sink):
    """Looks at two corners of each picture."""

    sink = HD
    corner_changes: bool = Property(False, doc="Whether a writer stands before it.")

    def start(self) -> None:
        """Has seen nothing."""
        self.torn: list[int] = []
        self.count = 0

    def render(self, frame: Frame) -> None:
        """The picture is the source's, but for the corner the writer changed."""
        value = frame.seq % 8
        corner = 255 if self.corner_changes and frame.seq % 100 == 0 else value
        if (frame.data[:4, :4] != corner).any() or (frame.data[-4:, -4:] != value).any():
            self.torn.append(frame.seq)
        if frame.seq != self.count:
            self.torn.append(-frame.seq)
        self.count += 1


def test_ten_thousand_pictures_through_tee_queues_and_a_writer(register: Register) -> None:
    """10 000 frames of 1080p BGR: none torn, none lost; the writer copies just those it writes into."""
    register(shared=Shared, writer=Writer, checks=Checks)
    text = """shared num-buffers=10000 ! tee name=t
        t. ! queue ! writer name=w ! checks name=changed corner-changes=true
        t. ! queue ! checks name=plain"""
    pipeline = Pipeline.parse(text)
    pipeline.run(timeout_s=80)
    assert (pipeline["changed"].count, pipeline["plain"].count) == (10_000, 10_000)
    assert pipeline["changed"].torn == []
    assert pipeline["plain"].torn == []
    assert (pipeline["w"].changed, pipeline["w"].copies) == (100, 100)
