"""When the reference plane changes, and to which keyframe: the centre constraint."""


def left_checkpoints(length: int) -> tuple[int, ...]:
    """..., n / 8, n / 4, n / 2 of a strip of `length` keyframes, ascending, each 2 or more."""
    return tuple(
        length >> halvings for halvings in range(length.bit_length(), 0, -1) if length >> halvings >= 2
    )


def right_checkpoints(length: int) -> tuple[int, ...]:
    """(n / 2 + n) / 2 and on, each halving the rest of a strip of `length` keyframes."""
    found, count = [], length // 2
    while length - count > 1:
        count = (count + length + 1) // 2
        found.append(count)
    return tuple(found)


def reference_at(count: int, strip_length: int = 0) -> int | None:
    """The keyframe that becomes the reference once there are `count`; None for no change.

    Where the length is known, the reference is the middle of the keyframes so far at n/8, n/4, ..., and from
    n/2 on keyframe n/2; the keyframes after it are adjusted again at 3n/4, 7n/8, ... Where it is unknown, the
    reference moves to keyframe n/2 whenever the number n of keyframes has doubled.

    Args:
        count: number of keyframes of the plane.
        strip_length: that of the whole strip, or 0 if unknown.

    Source: Zhang, Liu and Qu, Research on feature extraction method of UAV video image based on target
    tracking, section 2.1, steps 2 and 4.
    """
    left = left_checkpoints(strip_length)
    if not left:
        return count // 2 if count >= 4 and count & (count - 1) == 0 else None
    if count in left[:-1]:
        return count // 2
    # Keyframes count from 0: number `middle` is there when one more than that exist.
    middle = left[-1]
    return middle if count == middle + 1 or count in right_checkpoints(strip_length) else None
