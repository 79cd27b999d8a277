"""How a live connection treats a slow consumer: it drops packets up to a keyframe, and hides late frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from streamkit import Frame, FrameFlags
from streamkit_media.streams import StreamKind

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
    a keyframe is shown, and in any case one per second.
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
