"""How often frames that no keyframe matches are relocalised."""

from typing import Final

_EVERY: Final = 2
_OFTEN: Final = 4
_RARELY: Final = 16


def is_recognition_due(unmeasured: int, known: bool) -> bool:
    """Whether to relocalise a frame.

    Where the motion is known but keyframes never match, as over relief, the tries become rarer.

    Args:
        unmeasured: frames since the last one that a keyframe matched.
        known: whether the motion since the previous frame is known.
    """
    if known and unmeasured > _OFTEN:
        return unmeasured & (unmeasured - 1) == 0 or unmeasured % _RARELY == 0
    return unmeasured % _EVERY == 0
