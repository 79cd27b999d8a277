"""When the reference plane changes, and to which key picture's: the centre constraint."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Checkpoint:
    """What is due when a number of key pictures is reached.

    Attributes:
        reference: number of the key picture, counted from 0, whose plane becomes the reference.
        readjust: whether the pictures after it are to be adjusted on it.
    """

    reference: int
    readjust: bool = True


def left_checkpoints(length: int) -> tuple[int, ...]:
    """..., n / 8, n / 4, n / 2 of a strip of `length` key pictures, rising, each 2 or more."""
    found = []
    count = length // 2
    while count >= 2:
        found.append(count)
        count //= 2
    return tuple(reversed(found))


def right_checkpoints(length: int) -> tuple[int, ...]:
    """(n / 2 + n) / 2 and on, each halving what is left of a strip of `length` key pictures."""
    found = []
    count = length // 2
    while length - count > 1:
        count = (count + length + 1) // 2
        found.append(count)
    return tuple(found)


class ReferenceSchedule:
    """The changes of the reference plane over a flight strip.

    With the length of the strip known, the plane is that of the middle of what has been stitched at n/8, n/4,
    ..., and from n/2 on that of key picture n/2, which stays; what follows it is adjusted again at 3n/4,
    7n/8, ... Without it, the plane moves to key picture n/2 whenever the number n of key pictures has
    doubled, which is the same list read from its small end.

    Args:
        strip_length: key pictures of the strip, or 0 where nobody knows.

    Source: Zhang, Liu and Qu, Research on feature extraction method of UAV video image based on target
    tracking, section 2.1, steps 2 and 4.
    """

    def __init__(self, strip_length: int = 0) -> None:
        self._length = strip_length
        self._left = left_checkpoints(strip_length)
        self._right = frozenset(right_checkpoints(strip_length)) if self._left else frozenset()

    def at(self, count: int) -> Checkpoint | None:
        """What is due once `count` key pictures were taken."""
        if not self._left:
            return Checkpoint(count // 2) if count >= 4 and count & (count - 1) == 0 else None
        middle = self._left[-1]
        # Key picture number `middle` is the middle one; it has come when one more than that were taken.
        if count == middle + 1:
            return Checkpoint(middle)
        if count in self._left[:-1]:
            return Checkpoint(count // 2)
        return Checkpoint(middle) if count in self._right else None
