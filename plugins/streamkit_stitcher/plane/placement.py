"""Where a frame lies on the reference plane, and how that was found."""

import math
from dataclasses import dataclass

from streamkit.geometry.homography import FloatArray, normalised
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import PairwiseMotion


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a frame lies on the plane.

    Attributes:
        to_reference: float64[3, 3], the frame to the plane.
        std: predicted error at the worst corner, px, without that of its fields.
        match: with a keyframe; None where `to_reference` is a prediction.
        motion: since the last frame, where that was measured.
        is_recognised: whether features of a keyframe were matched, even if too few of them for `match`.
        is_due: whether the frame becomes a keyframe in any case.
        is_keyframe: whether the frame became a keyframe.
        change: float64[3, 3], old plane to new, where another keyframe took over or was adjusted, else None.
        field_error: how far the fields of an interlaced frame are from an even motion, px.
        is_adrift: whether the place on this plane is unknown, so that no keyframe may be made of it.
        is_elsewhere: whether features show another plane, on which the place is not certain enough.
    """

    to_reference: FloatArray
    std: float
    match: KeyframeMatch | None = None
    motion: PairwiseMotion | None = None
    is_recognised: bool = False
    is_due: bool = False
    is_keyframe: bool = False
    change: FloatArray | None = None
    field_error: float = 0.0
    is_adrift: bool = False
    is_elsewhere: bool = False

    @property
    def is_trusted(self) -> bool:
        """Whether a frame without a match may become a keyframe: a homography explains the motion."""
        return self.motion is not None and self.motion.model is MotionModel.HOMOGRAPHY

    @property
    def counts(self) -> tuple[int, int, float]:
        """Number of points compared, of those that agree, and their root mean square residual, px."""
        if self.match is not None:
            fit = self.match.fit
            return len(fit.inliers), fit.count, fit.rmse
        if self.motion is not None:
            return self.motion.matches, self.motion.inliers, self.motion.rmse
        return 0, 0, 0.0


def placed(keyframe: Keyframe, match: KeyframeMatch) -> Placement:
    """Where a match with a keyframe places the frame."""
    to_reference = normalised(keyframe.to_reference @ match.fit.matrix)
    return Placement(to_reference, math.hypot(match.corner_std, keyframe.corner_std), match)
