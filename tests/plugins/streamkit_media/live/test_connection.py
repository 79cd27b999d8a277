"""What a consumer gets of a connection, and what is counted, with telemetry beside the video."""

import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import av
from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit import Frame, FrameFlags
from streamkit.testing import ManualClock
from streamkit_media.decoding.marks import Freshness
from streamkit_media.live.connection import LATE, OVERRUN, LiveConnection
from streamkit_media.live.liveinput import LiveInput
from streamkit_media.live.timeline import PacketStamps
from streamkit_media.streams import DecodeOnly, StreamKind

Packets = list["Packet[Stream]"]


class Arranged(LiveInput):
    """Packets of a file in an order of its own; `is_read` is set when all have been read."""

    def __init__(self, path: Path, arrange: Callable[[Packets, Packets], Packets]) -> None:
        super().__init__(str(path), 20.0)
        self._arrange = arrange
        self.is_read = threading.Event()

    def open(self) -> InputContainer:
        return av.open(self.location)

    def packets(self, container: InputContainer, streams: Sequence[Stream]) -> "Iterator[Packet[Stream]]":
        found = [packet for packet in container.demux(list(streams)) if packet.size]
        video = [packet for packet in found if packet.stream.type == "video"]
        yield from self._arrange(video, [packet for packet in found if packet.stream.type == "data"])

    def close(self) -> None:
        self.is_read.set()


class Read(LiveConnection):
    """A connection of which everything has been read before the consumer takes the first packet."""

    source: Arranged

    def begin(self) -> None:
        super().begin()
        assert self.source.is_read.wait(20)


def connection_of(source: Arranged, max_packets: int, clock: ManualClock) -> tuple[Read, Counter[str]]:
    """A connection without patience for late packets, and what it counts as dropped."""
    drops: Counter[str] = Counter()
    kinds = frozenset({StreamKind.VIDEO, StreamKind.KLV})
    connection = Read(
        source, kinds, max_packets, 0, PacketStamps(clock), lambda reason, n: drops.update({reason: n})
    )
    connection.source = source
    return connection, drops


def taken(connection: LiveConnection) -> list[tuple[StreamKind, Frame]]:
    """Everything that comes out."""
    try:
        return list(connection.frames(threading.Event()))
    finally:
        assert connection.end(20)


def test_the_newest_frame_is_shown_whatever_telemetry_is_behind_it(clip: Path) -> None:
    """Of frames that have waited too long the newest one of the video is not late."""
    clock = ManualClock()
    connection, drops = connection_of(Arranged(clip, lambda video, klv: video[:4] + klv[:3]), 100, clock)
    frames = connection.frames(threading.Event())
    assert next(frames)[1].get(Freshness) is not None  # the first one is not late: nothing was waiting
    clock.advance(0.01)

    shown = [frame.get(DecodeOnly) is not LATE for kind, frame in frames if kind is StreamKind.VIDEO]
    assert shown == [False, False, True]
    assert not drops
    assert connection.end(20)


def test_dropped_telemetry_is_no_gap_of_the_video(clip: Path) -> None:
    """Every drop is counted; the video has a discontinuity only where one of its packets is missing."""
    connection, drops = connection_of(
        Arranged(clip, lambda video, klv: klv[:4] + video[:2]), 4, ManualClock()
    )
    frames = taken(connection)
    assert [kind for kind, _ in frames] == [StreamKind.VIDEO] * 2
    assert not any(frame.flags & FrameFlags.DISCONTINUITY for _, frame in frames)
    assert drops == {OVERRUN: 4}


def test_a_gap_is_marked_where_it_is(clip: Path) -> None:
    """The first frame of the video behind dropped ones has the flag."""

    def arrange(video: Packets, klv: Packets) -> Packets:
        keyframe = next(at for at, packet in enumerate(video) if at > 4 and packet.is_keyframe)
        return [*video[keyframe - 4 : keyframe + 1], klv[0], video[keyframe + 1]]

    connection, drops = connection_of(Arranged(clip, arrange), 4, ManualClock())
    marked = [bool(frame.flags & FrameFlags.DISCONTINUITY) for kind, frame in taken(connection)]
    assert marked == [True, False, False]
    assert drops == {OVERRUN: 4}


def test_what_is_dropped_behind_the_last_packet_taken_is_counted(clip: Path) -> None:
    """A consumer that has left takes nothing any more."""
    connection, drops = connection_of(
        Arranged(clip, lambda video, klv: klv[:4] + video[:2]), 4, ManualClock()
    )
    is_over = threading.Event()
    is_over.set()
    assert list(connection.frames(is_over)) == []
    assert drops == {OVERRUN: 4}
    assert connection.end(20)
