"""Dense alignment: all of a keyframe votes by area, so that large movers do not outvote weak texture."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    corner_shift,
    corners,
    inverse,
    project,
    resized,
    translation,
)
from streamkit_stitcher.registration.block_sums import SingleArray
from streamkit_stitcher.registration.dense_level import (
    STEP_RATIOS,
    BlockComparison,
    DenseLevel,
)
from streamkit_stitcher.registration.tilt import MotionPrior, TiltRatio, motion_prior, tilt_of


@dataclass(frozen=True, eq=False)
class DenseAlignment:
    """A frame aligned with a keyframe, px of the finest level.

    Attributes:
        key_to_frame: float64[3, 3].
        agreement: share of the contrast in view that agrees, less what agrees by chance, 0 to 1.
        corner_std: standard deviation of the best motion at the worst corner, px; that of its shear and
            perspective by this frame and the camera's `TiltRatio` alone, as their errors last.
        covariance: float64[8, 8], of the motion's parameters.
        step: float64[8], from the prediction.
        blocks: int64[k], numbers of the blocks that agree.
        compared: number of blocks in view.
        at_rest: whether `key_to_frame` is exactly the first prediction, which explains the frame as well.
        near_rest: whether the first prediction explains the frame about as well.
        displacements: float64[4, 2], of the corners by the best motion, from the first prediction, px.
        rmse: root mean square difference of the textures.
        tilt: float64[4], shear and perspective that this frame alone shows, see `tilt_of`.
        tilt_variances: float64[4], of these, px squared.
        evidence: float64[8], against each motion that is `doubted` px off, see `DenseLevel.neighbours`.
        bent_evidence: the least, against the two motions that are as far off where the best one is least
            certain, see `DenseLevel.least_certain`; infinite at rest.
    """

    key_to_frame: FloatArray
    agreement: float
    corner_std: float
    covariance: FloatArray
    step: FloatArray
    blocks: npt.NDArray[np.int64]
    compared: int
    at_rest: bool
    near_rest: bool
    displacements: FloatArray
    rmse: float
    tilt: FloatArray
    tilt_variances: FloatArray
    evidence: FloatArray
    bent_evidence: float

    @property
    def away(self) -> float:
        """Distance of the first prediction from the best motion at the worst corner, px."""
        return float(np.hypot(*self.displacements.T).max())


# Agreement below which it may be chance (other scenes: at most 0.028 in 132 pairs).
MIN_AGREEMENT: Final = 0.06
_AGREEING: Final = 0.5
# Rest must reach this share of the best agreement, within so many deviations (squared) of
# the best motion, which 0.2 % of eight parameters exceed by chance; both where it is no surer than others,
# and where it has always been right. Cameras at rest move by the jitter, px.
_AS_GOOD: Final = (0.85, 0.6)
_HELD: Final = (25.0, 75.0)
_JITTER: Final = 0.25
# Agreement by which a rival must exceed the found motion, in deviations of its parts of the frame.
_EVIDENT: Final = 3.0
# Distance at a corner, px, beyond which the shift found by correlation is a rival, and its length by the
# width above which it is that of photographs, which features register.
ELSEWHERE: Final = 8.0
_FARTHEST: Final = 0.25
_RIVAL_COVARIANCE: Final[FloatArray] = np.diag((2.0 * STEP_RATIOS) ** 2)
# Information, 1 / px squared, of a frame that shows nothing.
_UNSEEN: Final = 1e-4
# Shifts, px, under which only chance agrees.
_WRONG: Final = ((25.0, 17.0), (-25.0, 17.0))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A motion, what was known before, its covariance, and the comparison there, px of its level."""

    prior: MotionPrior
    motion: FloatArray
    posterior: FloatArray
    compared: BlockComparison

    @cached_property
    def information(self) -> FloatArray:
        """Of the frame alone, float64[8, 8]."""
        alone = np.linalg.inv(self.posterior) - np.linalg.inv(self.prior.covariance)
        return np.asarray(alone + _UNSEEN * np.eye(8))

    @cached_property
    def covariance(self) -> FloatArray:
        """Of the motion, without what earlier frames say of shear and perspective, float64[8, 8]."""
        return np.asarray(np.linalg.inv(self.information + self.prior.lasting), np.float64)

    def tilt(self, level: DenseLevel) -> FloatArray:
        """Shear and perspective where the frame alone has its maximum of likelihood, float64[4]."""
        step = level.step_of(inverse(self.prior.start) @ self.motion)
        beyond = np.linalg.solve(self.information, np.linalg.solve(self.prior.covariance, step))
        return np.asarray(tilt_of(level, self.motion) + beyond[4:])


def align_densely(
    levels: Sequence[DenseLevel],
    textures: Sequence[SingleArray],
    predictions: Sequence[FloatArray],
    covariance: FloatArray,
    rest_share: float | None = None,
    shakes: bool = False,
    tilt: TiltRatio | None = None,
    doubted: float = 2.0,
) -> DenseAlignment:
    """Aligns a frame with a keyframe, coarse to fine, by all blocks that can agree.

    Blocks count by their contrast relative to their neighbourhood and are left out as they differ: movers,
    water, leaves. Another motion replaces the result with evidence from all over the frame, as a mover offers
    the motion of its own part of it: the shift at which the textures correlate best, and motions `doubted` px
    off.

    Args:
        levels: of the keyframe, coarsest first.
        textures: of the frame, one of the size of each level, see `textures_of`.
        predictions: keyframe to frame.
        covariance: float64[8, 8], of the step from a prediction, px.
        rest_share: share of the latest frames that the first prediction explained, 0 to 1. It is kept where
            it explains the frame about as well as any motion; the larger the share, the less well is enough.
            None to prefer no prediction.
        shakes: whether the camera moves about the first prediction: it is not kept then.
        tilt: how much the camera tilts as it moves; None if that is unknown.
        doubted: error of the worst corner that the result is tested for, px.

    Source: Black and Anandan, The robust estimation of multiple motions, CVIU 1996; Irani, Rousso and Peleg,
    Computing occluding and transparent motions, IJCV 1994.
    """
    finest, image, tilt = levels[-1], textures[-1], tilt or TiltRatio()
    best = _best(levels, textures, predictions, covariance, tilt)
    near_rest, motion, compared = False, best.motion, best.compared
    if rest_share is not None:
        resting = finest.compare(image, predictions[0])
        near_rest = _is_rest(finest, predictions[0], resting, best, rest_share)
    at_rest = near_rest and not shakes
    if at_rest:
        motion, compared = predictions[0], resting
    neighbours = finest.neighbours(doubted)
    evidence = _evidence(finest, image, motion, compared, neighbours)
    # One frame of movers does not outweigh many at rest.
    needed = _EVIDENT * (1 + rest_share) if at_rest and rest_share is not None else _EVIDENT
    if evidence.min() < -needed:
        start = motion @ neighbours[int(evidence.argmin())]
        rival = motion_prior(finest, start, _RIVAL_COVARIANCE, tilt)
        moved = _Fit(rival, *finest.refine(image, start, rival.start, rival.covariance))
        confirmed = _evidence(finest, image, moved.motion, moved.compared, neighbours)
        # Where the scene is hidden, a motion that agrees by chance has better ones beside it, too.
        if confirmed.min() > 0:
            best, at_rest, near_rest, evidence = moved, False, False, confirmed
            motion, compared = moved.motion, moved.compared
    bent_evidence = math.inf
    if not at_rest:
        bent = finest.least_certain(best.covariance, doubted)
        bent_evidence = float(_evidence(finest, image, motion, compared, bent).min())
    outline = corners(finest.shape)
    return DenseAlignment(
        motion,
        _beyond_chance(finest, image, motion, compared),
        finest.corner_std(best.covariance),
        best.posterior,
        finest.step_of(inverse(best.prior.start) @ motion),
        np.flatnonzero(compared.weights > _AGREEING),
        int(np.count_nonzero(compared.visible)),
        at_rest,
        near_rest,
        project(inverse(predictions[0]) @ best.motion, outline) - outline,
        float(np.sqrt(compared.variance)),
        best.tilt(finest),
        np.diag(np.linalg.inv(best.information))[4:],
        evidence,
        bent_evidence,
    )


def _best(
    levels: Sequence[DenseLevel],
    textures: Sequence[SingleArray],
    predictions: Sequence[FloatArray],
    covariance: FloatArray,
    tilt: TiltRatio,
) -> _Fit:
    """The best motion near the predictions, else elsewhere."""
    finest = levels[-1]
    coarsest = 2 ** (len(levels) - 1)
    scores = [
        levels[0].compare(textures[0], resized(prediction, 1 / coarsest)).agreement
        for prediction in predictions
    ]
    prior = motion_prior(finest, predictions[int(np.argmax(scores))], covariance, tilt)
    best = _refined(levels, textures, prior)
    shift = resized(levels[0].shift_to(textures[0]), coarsest)
    is_near = float(np.hypot(*shift[:2, 2])) < _FARTHEST * finest.shape[1]
    is_other = corner_shift(inverse(shift) @ best.motion, finest.shape) > ELSEWHERE
    if is_near and is_other:
        known, moved = (
            levels[0].compare(textures[0], resized(matrix, 1 / coarsest)) for matrix in (best.motion, shift)
        )
        # To refine it takes most of the time: only where the coarsest level prefers the shift as it is.
        if levels[0].evidence(moved, known) > 0:
            rival = _refined(levels, textures, motion_prior(finest, shift, _RIVAL_COVARIANCE, tilt))
            best = rival if finest.evidence(rival.compared, best.compared) > _EVIDENT else best
    return best


def _evidence(
    finest: DenseLevel,
    image: SingleArray,
    motion: FloatArray,
    compared: BlockComparison,
    neighbours: Sequence[FloatArray],
) -> FloatArray:
    """Evidence for a motion, whose comparison is given, against motions a step away, float64[n]."""
    return np.array([finest.evidence(compared, finest.compare(image, motion @ step)) for step in neighbours])


def _beyond_chance(
    finest: DenseLevel, image: SingleArray, motion: FloatArray, compared: BlockComparison
) -> float:
    """Share of the contrast that agrees with a motion, less what agrees with wrong shifts, 0 to 1."""
    chance = np.mean([finest.compare(image, motion @ translation(np.array(by))).agreement for by in _WRONG])
    return max(0.0, float((compared.agreement - chance) / (1 - chance)))


def _refined(levels: Sequence[DenseLevel], textures: Sequence[SingleArray], prior: MotionPrior) -> _Fit:
    """`DenseLevel.refine` from coarse to fine."""
    motion = resized(prior.start, 1 / 2 ** len(levels))
    for number, (level, image) in enumerate(zip(levels, textures, strict=True)):
        size = 2 ** (len(levels) - 1 - number)
        begin, covariance = resized(prior.start, 1 / size), prior.covariance / size**2
        motion, posterior, compared = level.refine(image, resized(motion, 2), begin, covariance)
    return _Fit(prior, motion, posterior, compared)


def _is_rest(
    finest: DenseLevel, prediction: FloatArray, resting: BlockComparison, best: _Fit, rest_share: float
) -> bool:
    """Whether a prediction, with its comparison, explains the frame about as well as the best motion."""
    allowed = np.linalg.inv(best.posterior + np.diag((_JITTER * STEP_RATIOS) ** 2))
    apart = finest.step_of(inverse(prediction) @ best.motion)
    held, as_good = (low + rest_share * (high - low) for low, high in (_HELD, _AS_GOOD))
    return bool(apart @ allowed @ apart < held and resting.agreement > as_good * best.compared.agreement)
