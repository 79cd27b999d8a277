"""One connection: a thread reads it, its packets come out as frames, a watchdog notices when none come."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from av.container import InputContainer
from av.packet import Packet
from av.stream import Stream

from streamkit import Caps, Frame, FrameFlags, ResourceError, StreamError, StreamkitError, mask_secrets
from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_media.container import other_videos
from streamkit_media.decoding.marks import Freshness
from streamkit_media.failures import ConnectionLost, silence
from streamkit_media.live.liveinput import LiveInput
from streamkit_media.live.timeline import PacketStamps
from streamkit_media.streams import DecodeOnly, StreamKind, stream_caps, streams_of

CUT_EVERY_S = 0.05
WATCHDOG_MARGIN_S = 0.3
POLL_S = 0.5
LATE = DecodeOnly("late: a newer frame had come")
OVERRUN = "consumer too slow, older packets dropped"
MAX_WAIT_NS = 500_000_000
# Streams with intra refresh have no keyframes: after so many refused packets the next one is accepted.
KEYFRAME_PATIENCE = 300
MAX_PAUSE_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class QueuedPacket:
    """A packet between the thread that reads and the source's; `number` counts those of its kind."""

    kind: StreamKind
    number: int
    frame: Frame

    @property
    def is_keyframe(self) -> bool:
        """Whether decoding of the video can begin with it."""
        return self.kind is StreamKind.VIDEO and bool(self.frame.flags & FrameFlags.KEYFRAME)


class DropToKeyframe:
    """Has a full queue drop the oldest packets up to a keyframe, so that frames stay decodable.

    Without a later keyframe it drops all; if there was video among them, it refuses the video until the next.

    Args:
        longest_wait_ns: once the oldest packet has waited longer, the next keyframe replaces all before it.
    """

    def __init__(self, longest_wait_ns: int) -> None:
        self._longest_wait_ns = longest_wait_ns
        self._refused = 0
        self._awaits_keyframe = False

    def __call__(self, held: Sequence[QueuedPacket], new: QueuedPacket, is_full: bool) -> range:
        """The indices of the packets to drop; the new packet has the index after the last held."""
        if self._awaits_keyframe and new.kind is StreamKind.VIDEO:
            if not new.is_keyframe and self._refused < KEYFRAME_PATIENCE:
                self._refused += 1
                return range(len(held), len(held) + 1)
            self._awaits_keyframe, self._refused = False, 0
        is_aged = len(held) > 0 and new.frame.arrival_ns - held[0].frame.arrival_ns > self._longest_wait_ns
        if not is_full and not is_aged:
            return range(0)
        keyframes = (at for at in range(len(held) - 1, 0, -1) if held[at].is_keyframe)
        count = len(held) if new.is_keyframe else next(keyframes, 0)
        if is_full and not count:
            self._awaits_keyframe = any(packet.kind is StreamKind.VIDEO for packet in (*held, new))
            return range(len(held) + 1)
        return range(count)


class CatchUp:
    """Once a frame has waited too long, frames are decoded but not shown, up to the newest.

    Where decoding is slower than the stream there are always newer ones: then the first frame after a jump to
    a keyframe is shown, and in any case one per second. The newest is known here only: `decode`, which has a
    rule for frames that wait between, leaves out the newest too, and waits for another.
    """

    def __init__(self, latency_ns: int, now_ns: int) -> None:
        self._latency_ns, self._shown_ns = latency_ns, now_ns
        self._is_behind = False

    def hides(self, arrival_ns: int, now_ns: int, *, is_wanted: bool) -> bool:
        """Decides on the next frame; `is_wanted` is the newest, and the first after a jump."""
        if is_wanted or now_ns - self._shown_ns > MAX_PAUSE_NS:
            self._is_behind = False
        elif now_ns - arrival_ns > self._latency_ns:
            self._is_behind = True
        if not self._is_behind:
            self._shown_ns = now_ns
        return self._is_behind


class LiveConnection:
    """Opens an input and reads it to its end in a thread of its own, which can be ended at any moment.

    Args:
        source: what is read; its limits are FFmpeg's, so the queue is watched as well.
        kinds: streams to read; the video must be there.
        max_packets: most packets queued for a slow consumer.
        latency_ms: packets that wait longer, here or in the decoder, are decoded but not shown.
        stamps: gives packets their numbers and times.
        count_drop: called in the thread that reads, with the reason and number of dropped packets.
    """

    def __init__(
        self,
        source: LiveInput,
        kinds: frozenset[StreamKind],
        max_packets: int,
        latency_ms: int,
        stamps: PacketStamps,
        count_drop: Callable[[str, int], None],
    ) -> None:
        self._source, self._kinds, self._stamps, self._count_drop = source, kinds, stamps, count_drop
        latency_ns = latency_ms * 1_000_000
        self._freshness = Freshness(latency_ns)
        self._catch_up = CatchUp(latency_ns, stamps.clock.monotonic_ns())
        self._ending = threading.Event()
        # caps of the streams that are there, and further videos, known before the first packet is queued
        self.found: dict[StreamKind, Caps] = {}
        self.unread_videos: list[int] = []
        self._received: Counter[StreamKind] = Counter()
        # The number of the next packet of each kind; a connection that follows another begins with a gap.
        self._expected = dict.fromkeys(kinds, -1 if stamps.next_seq else 0)
        # packets between the thread that reads and the source's
        self.queue = BoundedQueue[QueuedPacket](
            max_packets, choose_dropped=DropToKeyframe(max(MAX_WAIT_NS, latency_ns))
        )
        # Not a daemon: it is always joined, and FFmpeg's limits bound it.
        self._thread = threading.Thread(target=self._run, name=f"reader {source.where}", daemon=False)

    def begin(self) -> None:
        """Starts reading."""
        self._thread.start()

    def end(self, limit_s: float) -> bool:
        """Ends reading and waits; whether the thread has ended, else it does within FFmpeg's own limit."""
        self._ending.set()
        deadline = time.monotonic() + limit_s
        while self._thread.is_alive():
            self._source.cut()
            self._thread.join(min(CUT_EVERY_S, max(0.0, deadline - time.monotonic())))
            if time.monotonic() >= deadline:
                break
        return not self._thread.is_alive()

    def frames(self, is_over: threading.Event) -> Iterator[tuple[StreamKind, Frame]]:
        """The packets as they come, until the stream ends.

        Args:
            is_over: set to stop; `queue.wake` then ends a wait at once.

        Raises:
            ResourceError: the server refuses, is silent for the time limit, or ends in an error.
        """
        queue, timeout_s = self.queue, self._source.timeout_s
        self.begin()
        last = time.monotonic()
        while not is_over.is_set():
            packet = queue.get(min(POLL_S, timeout_s), is_over)
            if packet is not None:
                yield packet.kind, self._taken(packet)
                # The consumer's own time is not the server's silence.
                last = time.monotonic()
            elif queue.is_over:
                return
            elif time.monotonic() - last > timeout_s + WATCHDOG_MARGIN_S:
                raise silence(self._source.where, timeout_s)

    def _taken(self, packet: QueuedPacket) -> Frame:
        """The frame of a packet, marked where packets before it are missing, and where it comes too late."""
        frame, has_gap = packet.frame, packet.number != self._expected[packet.kind]
        self._expected[packet.kind] = packet.number + 1
        if has_gap:
            frame = frame.replace(flags=frame.flags | FrameFlags.DISCONTINUITY)
        if packet.kind is StreamKind.VIDEO:
            is_newest = packet.number + 1 == self._received[StreamKind.VIDEO]
            now_ns = self._stamps.clock.monotonic_ns()
            if self._catch_up.hides(frame.arrival_ns, now_ns, is_wanted=is_newest or has_gap):
                frame = frame.attach(LATE)
        return frame

    # The thread that reads.

    def _run(self) -> None:
        error: Exception | None = None
        try:
            with self._source.open() as container:
                if not self._ending.is_set():
                    self._read_from(container)
        except StreamkitError as cause:
            error = cause
        except Exception as cause:  # raised by the queue in the consumer's thread
            error = ResourceError(f"{self._source.where}: {mask_secrets(str(cause))}")
        finally:
            self._source.close()
            self.queue.end(None if self._ending.is_set() else error)

    def _read_from(self, container: InputContainer) -> None:
        source = self._source
        video = source.video_of(container)
        self.unread_videos = other_videos(container, video) if source.video_index is None else []
        streams = [
            (video if kind is StreamKind.VIDEO else stream, kind)
            for stream, kind in streams_of(container, self._kinds)
        ]
        carried = {stream.index: (stream_caps(stream, kind), kind) for stream, kind in streams}
        self.found = {kind: caps for caps, kind in carried.values()}
        due = time.monotonic() + source.timeout_s
        try:
            for packet in source.packets(container, [stream for stream, _ in streams]):
                if self._ending.is_set():
                    return
                # At its time limit FFmpeg gives out the piece of a frame it holds, then waits as long again.
                if time.monotonic() >= due:
                    raise silence(source.where, source.timeout_s)
                self._arrived(packet, *carried[packet.stream_index])
                due = time.monotonic() + source.timeout_s
        except ConnectionLost:
            raise
        except StreamError as error:
            if time.monotonic() >= due:
                raise silence(source.where, source.timeout_s) from None
            raise StreamError(f"{source.where}: {error}; check that the server still runs") from None

    def _arrived(self, packet: Packet[Stream], caps: Caps, kind: StreamKind) -> None:
        """Queues a packet with its number and times."""
        frame = self._stamps.stamped(packet, caps)
        if kind is StreamKind.VIDEO:
            frame = frame.attach(self._freshness)
        queued = QueuedPacket(kind, self._received[kind], frame)
        self._received[kind] += 1
        if dropped := self.queue.put(queued):
            self._count_drop(OVERRUN, dropped)
