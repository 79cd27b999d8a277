"""Times of frames whose container stores the order of coding in place of that of presentation."""

from __future__ import annotations

from bisect import bisect_left, insort

from streamkit_media.decoding.marks import PENDING_LIMIT

WRONG_TIMES_CODE = "wrong-times"  # of the warning
WRONG_TIMES = (
    "the times of the packets are in order of coding, not of presentation, as of a writer that knows no "
    "B-frames; the frames take them in ascending order"
)


class PresentationTimes:
    """Gives each frame its packet's time, or the next one in order where the packets' times are wrong.

    Some writers store no composition offsets: the packets of a stream with B-frames then have the times of
    their decoding. Decoders give out frames in order of presentation, so the times of the packets, ascending,
    are those of the frames. The first reordered frame decides: where packets are in order of coding and their
    times are those of presentation, the times of packets cannot ascend. Times that step back, as of a camera
    whose clock was set, are left as they are.

    Attributes:
        are_wrong: whether the packets' times are found to be in order of coding.
    """

    def __init__(self) -> None:
        self.are_wrong = False
        self._waiting: list[int] = []  # times of packets without a frame yet, ascending, ns
        self._newest: int | None = None
        self._last: int | None = None
        self._is_ascending = True

    def add(self, pts: int | None) -> None:
        """Notes the time of a packet that the decoder gets, ns."""
        if pts is None:
            return
        if self._newest is not None and pts <= self._newest:
            # In order of coding they would ascend.
            self._is_ascending = self.are_wrong = False
        self._newest = pts
        insort(self._waiting, pts)
        del self._waiting[:-PENDING_LIMIT]

    def leave_out(self, pts: int | None) -> None:
        """Notes that the packet of this time gives no frame."""
        if pts is not None and pts in self._waiting:
            self._waiting.remove(pts)

    def take(self, pts: int | None, *, is_bidirectional: bool, is_key: bool) -> int | None:
        """Returns the time of the next frame in order of presentation.

        Args:
            pts: of the frame's packet, ns; None where it has none.
            is_bidirectional: whether it is a B-frame.
            is_key: whether it is a keyframe. The frames before it in one order are before it in the other,
                so that its time is right, and frames lost before it no longer count.
        """
        if pts is None:
            return None
        waiting = self._waiting
        is_late = is_bidirectional and bool(waiting) and waiting[0] < pts
        is_early = self._last is not None and pts < self._last
        self.are_wrong |= self._is_ascending and (is_late or is_early)
        if not self.are_wrong:
            if pts in waiting:
                waiting.remove(pts)
            self._last = pts
            return pts
        earliest = pts if self._last is None else self._last + 1
        if self._last is not None or is_key:
            del waiting[: bisect_left(waiting, max(earliest, pts) if is_key else earliest)]
        self._last = waiting.pop(0) if waiting else earliest
        return self._last
