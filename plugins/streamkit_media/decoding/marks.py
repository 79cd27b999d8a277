"""What a picture says of those before it: damage lasts until it heals, a discontinuity until it is shown."""

from __future__ import annotations

# Pictures built on a damaged one are damaged too, until a key frame; streams without any heal in time.
DAMAGE_LASTS = 300


class PictureMarks:
    """Follows all packets and pictures of one stream, also those that are not shown."""

    def __init__(self) -> None:
        self._damage = 0
        self._carries = False

    @property
    def is_damaged(self) -> bool:
        """Whether the last picture is not whole, or built on one that is not."""
        return self._damage > 0

    def packet_left_out(self, *, is_discontinuity: bool, is_damage: bool) -> None:
        """A packet becomes no picture.

        Args:
            is_discontinuity: whether it was the first after a gap.
            is_damage: whether pictures are built on it all the same.
        """
        self._carries |= is_discontinuity
        if is_damage:
            self._damage = DAMAGE_LASTS

    def next_picture(self, *, is_corrupt: bool, is_key: bool) -> None:
        """A picture has been decoded.

        Args:
            is_corrupt: whether it is not whole.
            is_key: whether it is built on no other.
        """
        if is_corrupt:
            self._damage = DAMAGE_LASTS
        elif self._damage:
            self._damage = 0 if is_key else self._damage - 1

    def take_discontinuity(self) -> bool:
        """Whether a gap lies between the picture that is shown now and the one shown before."""
        carries, self._carries = self._carries, False
        return carries
