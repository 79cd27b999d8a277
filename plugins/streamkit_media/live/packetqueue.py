"""The queue between a reader's thread and its source, which drops up to a key frame when it is full."""

from __future__ import annotations

from collections.abc import Sequence

from streamkit import Frame, FrameFlags
from streamkit.handoff.bounded_queue import BoundedQueue
from streamkit_media.streams import StreamKind

# Streams with intra refresh have no key frames: after so many refused packets the next one is accepted.
KEYFRAME_PATIENCE = 300


def packet_queue(capacity: int, longest_wait_ns: int) -> BoundedQueue[Frame]:
    """A queue of packets that never waits for room, see `DropToKeyframe`; `capacity` is the most queued."""
    return BoundedQueue(capacity, choose_dropped=DropToKeyframe(longest_wait_ns))


class DropToKeyframe:
    """Has a full queue drop the oldest packets up to a key frame, so that frames stay decodable.

    Without a later key frame it drops all, and refuses packets until the next one.

    Args:
        longest_wait_ns: once the oldest packet has waited longer, the next key frame replaces all before it.
    """

    def __init__(self, longest_wait_ns: int) -> None:
        self._longest_wait_ns = longest_wait_ns
        self._refused = 0
        self._awaits_keyframe = False

    def __call__(self, held: Sequence[Frame], new: Frame, is_full: bool) -> range:
        """The indices of the packets to drop; the new packet has the index after the last held."""
        if self._awaits_keyframe and not is_keyframe(new) and self._refused < KEYFRAME_PATIENCE:
            self._refused += 1
            return range(len(held), len(held) + 1)
        self._awaits_keyframe, self._refused = False, 0
        is_aged = len(held) > 0 and new.arrival_ns - held[0].arrival_ns > self._longest_wait_ns
        if not is_full and not is_aged:
            return range(0)
        keyframes = (at for at in range(len(held) - 1, 0, -1) if is_keyframe(held[at]))
        count = len(held) if is_keyframe(new) else next(keyframes, 0)
        if is_full and not count:
            self._awaits_keyframe = True
            return range(len(held) + 1)
        return range(count)


def is_keyframe(packet: Frame) -> bool:
    """Whether decoding of the video can begin with a packet; packets of other streams carry their kind."""
    return bool(packet.flags & FrameFlags.KEYFRAME) and packet.get(StreamKind) is None
