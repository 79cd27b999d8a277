"""How often the dear ways to register a frame are tried: relocalisation, and alignment by the whole area."""

from typing import Final

_EVERY: Final = 2
_OFTEN: Final = 4
_RARELY: Final = 16
_CONFIRMATIONS: Final = 3
_LONGEST_PAUSE: Final = 8


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


class CheckPauses:
    """When patches that the whole area keeps confirming are checked by it again: more and more rarely.

    The alignment of the area costs six times as much as following the patches. In a scene with many movers it
    confirms the patches in every frame; where movers win among the patches, it does not.
    """

    def __init__(self) -> None:
        self._confirmed = self._pause = 0

    def is_due(self) -> bool:
        """Whether to check a frame; call it once for each frame that may be checked."""
        self._pause = max(0, self._pause - 1)
        return self._pause == 0

    def add(self, is_confirmed: bool) -> None:
        """Adds the result of a check."""
        self._confirmed = self._confirmed + 1 if is_confirmed else 0
        doublings = self._confirmed - _CONFIRMATIONS
        self._pause = 0 if doublings < 0 else 1 + min(2**doublings, _LONGEST_PAUSE)
