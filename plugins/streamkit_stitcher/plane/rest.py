"""Whether a camera rests where it was at its keyframe."""

import math
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray
from streamkit_stitcher.registration.dense_alignment import MIN_AGREEMENT, DenseAlignment

_FIRST_SHARE: Final = 0.7
# Frames after which the first beliefs count half, part of the later ones that each frame replaces, and frames
# over which evidence adds up.
_FIRST_FRAMES: Final = 10
_GAIN: Final = 0.02
_MEMORY: Final = 300
# Part of the mean position that each frame replaces: a camera that sways does so within some sixty frames.
_POSITION_GAIN: Final = 0.1
# Distance of a frame from the mean position, in predicted deviations, that counts at most, and the mean
# square that a camera at rest reaches where the prediction is honest.
_MOST_AWAY: Final = 3.0
_RESTING: Final = 1.0


class RestBelief:
    """How often a camera is where it was at its keyframe, and whether it shakes about that place.

    A camera that shakes by about a pixel is near rest in each of its frames, where that explains the frame
    about as well as any motion. It is distinguished from one at rest by the scatter of many frames' best
    motions about their mean, which at rest is no larger than their predicted errors. One that has moved once
    by less than a pixel still rests.

    Attributes:
        share: of the latest frames that rest explained about as well as any motion, 0 to 1.
    """

    def __init__(self) -> None:
        self.share, self._scatter, self._seen = _FIRST_SHARE, 0.0, 0
        self._position: FloatArray | None = None

    @property
    def shakes(self) -> bool:
        """Whether frames lie farther from their mean position than their errors explain."""
        return self._scatter > _RESTING

    def learn(self, found: DenseAlignment) -> None:
        """Learns from a frame."""
        self._seen += 1
        gain = max(_GAIN, 1 / (_FIRST_FRAMES + self._seen))
        self.share += gain * (found.near_rest - self.share)
        if not found.near_rest or found.agreement < MIN_AGREEMENT:
            return
        position = found.displacements if self._position is None else self._position
        away = (found.displacements - position) / found.corner_std
        distance = float(np.hypot(*away.T).max())
        # Movers bend single frames by any amount.
        counted = min(distance, _MOST_AWAY)
        self._position = position + _POSITION_GAIN * found.corner_std * counted / max(distance, 1e-9) * away
        self._scatter += gain * (counted**2 - self._scatter)


class RestEvidence:
    """Evidence that a camera is where its frames are held, over the frames that it rested at one place.

    Args:
        keyframe: number of the keyframe that it is compared with.
    """

    def __init__(self, keyframe: int = -1) -> None:
        self.keyframe = keyframe
        self._sum, self._variance = np.zeros(8), 0.0

    def add(self, evidence: FloatArray) -> float:
        """Adds a frame's `DenseAlignment.evidence`; returns the probability that another motion is right.

        Movers that hide the scene speak against the truth for some frames; a camera that drifts off does so
        in every frame from then on.
        """
        kept = 1 - 1 / _MEMORY
        self._sum, self._variance = kept * self._sum + evidence, kept**2 * self._variance + 1
        deviations = float(self._sum.min()) / math.sqrt(self._variance)
        return probability_beyond(deviations)


def probability_beyond(deviations: float) -> float:
    """Probability that a standard normal variable is larger."""
    return math.erfc(deviations / math.sqrt(2)) / 2
