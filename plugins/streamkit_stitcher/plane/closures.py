"""Which ties across flight strips are believed: ground repeats itself, and one false tie bends the plane."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, project, scale_change
from streamkit_stitcher.plane.graph import Tie

# How far two key pictures may lie from their true places to each other, as a part of the width: errors of
# direction add up twice along the ties between them. Beyond the last, somebody else has to say so, too.
_ALLOWED: Final = 0.01
_GROWTH: Final = 1.5
_MOST_ALLOWED: Final = 0.1
# Between key pictures this few ties apart nothing adds up, whoever says so.
FEW_STEPS: Final = 4
_AGREEING: Final = 0.05
_NEIGHBOURS: Final = 4
_WAITING: Final = 8
_SETTLED: Final = 0.003
_ALIKE: Final = 0.5


class ClosureEvidence:
    """Judges ties to key pictures that were only thought to show the same ground.

    A tie is believed where it puts its key pictures about where they lie already, as near as the ties between
    them let expect. One that asks for more must show the same ground wherever its key pictures overlap, and
    waits until another of about the same time asks for the same.
    """

    def __init__(self) -> None:
        self._waiting: list[Tie] = []
        self._is_far = False

    @property
    def is_far(self) -> bool:
        """Whether a tie that was believed last moves more than the newest few key pictures."""
        return self._is_far

    def believed(
        self,
        ties: Sequence[Tie],
        places: Mapping[int, FloatArray],
        steps: Mapping[int, int],
        shape: tuple[int, int],
    ) -> tuple[Tie, ...]:
        """The ties that can be trusted by now, earlier ones among them.

        Args:
            ties: of one newest key picture.
            places: float64[3, 3] of the key pictures, their pixels to the plane.
            steps: by key picture, along how many ties it is reached from the newest; others are far.
            shape: (height, width) of the newest, px.
        """
        found: list[Tie] = []
        self._is_far = False
        for tie in ties:
            if tie.host not in places or tie.observer not in places:
                continue
            asked, apart = _asked(tie, places), steps.get(tie.host)
            width = shape[1] * scale_change(places[tie.observer], shape)
            distance = float(np.hypot(*asked))
            if distance <= width * _allowed(apart):
                found.append(tie)
                self._is_far |= distance > width * _SETTLED
            elif tie.likeness > _ALIKE and (apart is None or apart > FEW_STEPS):
                agreeing = self._agreeing(tie, asked, places, width * _AGREEING)
                self._waiting = [other for other in self._waiting if other not in agreeing]
                if agreeing:
                    found.extend([*agreeing, tie])
                    self._is_far = True
                else:
                    self._waiting.append(tie)
        self._waiting = self._waiting[-_WAITING:]
        return tuple(found)

    def _agreeing(
        self, tie: Tie, asked: FloatArray, places: Mapping[int, FloatArray], within: float
    ) -> list[Tie]:
        """Waiting ties of about the same time that ask for about the same, to `within` px of the plane."""
        return [
            other
            for other in self._waiting
            if tie.observer - other.observer <= _NEIGHBOURS
            and other.observer in places
            and other.host in places
            and np.hypot(*(_asked(other, places) - asked)) <= within
        ]


def _allowed(steps: int | None) -> float:
    return _MOST_ALLOWED if steps is None else min(_MOST_ALLOWED, _ALLOWED * steps**_GROWTH)


def _asked(tie: Tie, places: Mapping[int, FloatArray]) -> FloatArray:
    """How a tie wants its observer moved against its host, float64[2], px of the plane."""
    apart = project(places[tie.host], tie.host_points) - project(places[tie.observer], tie.points)
    return np.asarray(np.median(apart, axis=0))
