"""Flags that outlast a frame: damage until it heals, a discontinuity until a frame is shown."""

from __future__ import annotations

# Frames that depend on a damaged one are damaged, too, until a key frame; streams without one heal in time.
DAMAGE_LASTS = 300


class FrameMarks:
    """Follows all packets and frames of one stream, also those that are not shown."""

    def __init__(self) -> None:
        self._damaged_frames_left = 0
        self._has_discontinuity = False

    @property
    def is_damaged(self) -> bool:
        """Whether the last frame, or one that it depends on, is damaged."""
        return self._damaged_frames_left > 0

    def packet_dropped(self, *, is_discontinuity: bool, is_damage: bool) -> None:
        """A packet gives no frame; `is_damage` means that later frames depend on it."""
        self._has_discontinuity |= is_discontinuity
        if is_damage:
            self._damaged_frames_left = DAMAGE_LASTS

    def next_frame(self, *, is_corrupt: bool, is_key: bool) -> None:
        """A frame has been decoded; `is_key` means that it depends on no other."""
        if is_corrupt:
            self._damaged_frames_left = DAMAGE_LASTS
        elif self._damaged_frames_left:
            self._damaged_frames_left = 0 if is_key else self._damaged_frames_left - 1

    def take_discontinuity(self) -> bool:
        """Whether there is a gap between this shown frame and the one shown before."""
        found, self._has_discontinuity = self._has_discontinuity, False
        return found
