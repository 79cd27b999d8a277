"""The queue of a live connection: it never waits for a slow consumer, but drops packets up to a keyframe."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from streamkit import Frame, FrameFlags
from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_media.streams import StreamKind

# Streams with intra refresh have no keyframes: after so many refused packets the next one is accepted.
KEYFRAME_PATIENCE = 300


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


def packet_queue(capacity: int, longest_wait_ns: int) -> BoundedQueue[QueuedPacket]:
    """A queue of packets that never waits for room, see `DropToKeyframe`; `capacity` is the most queued."""
    return BoundedQueue(capacity, choose_dropped=DropToKeyframe(longest_wait_ns))


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
