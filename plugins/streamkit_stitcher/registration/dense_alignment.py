"""Dense alignment: all of a keyframe votes by area, so that large movers do not outvote weak texture."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    corner_shift,
    from_reduced,
    inverse,
    to_reduced,
    translation,
)
from streamkit_stitcher.registration.block_sums import SingleArray
from streamkit_stitcher.registration.dense_level import (
    STEP_RATIOS,
    BlockComparison,
    DenseLevel,
    levels_of,
    texture,
)


@dataclass(frozen=True, eq=False)
class DenseAlignment:
    """A frame aligned with a keyframe, px of the finest level.

    Attributes:
        key_to_frame: float64[3, 3].
        agreement: share of the contrast in view that agrees, less what agrees by chance, 0 to 1.
        corner_std: standard deviation of the best motion at the worst corner, px.
        covariance: float64[8, 8], of the motion's parameters.
        step: float64[8], from the prediction.
        blocks: int64[k], numbers of the blocks that agree.
        compared: number of blocks in view.
        at_rest: whether `key_to_frame` is exactly the first prediction, which explains the frame as well.
        away: distance of the first prediction from the best motion at the worst corner, px.
        rmse: root mean square difference of the textures.
        evidence: float64[8], against each motion that is `doubted` px off, see `DenseLevel.neighbours`.
    """

    key_to_frame: FloatArray
    agreement: float
    corner_std: float
    covariance: FloatArray
    step: FloatArray
    blocks: npt.NDArray[np.int64]
    compared: int
    at_rest: bool
    away: float
    rmse: float
    evidence: FloatArray


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
# Shifts, px, under which only chance agrees.
_WRONG: Final = ((25.0, 17.0), (-25.0, 17.0))


@dataclass(frozen=True, eq=False)
class _Fit:
    """A motion, where its search began, its covariance, and the comparison there."""

    start: FloatArray
    motion: FloatArray
    posterior: FloatArray
    compared: BlockComparison


def align_densely(
    levels: Sequence[DenseLevel],
    grey: GreyArray,
    predictions: Sequence[FloatArray],
    covariance: FloatArray,
    rest_share: float | None = None,
    doubted: float = 2.0,
) -> DenseAlignment:
    """Aligns a frame with a keyframe, coarse to fine, by all blocks that can agree.

    Blocks count by their contrast relative to their neighbourhood and are left out as they differ: movers,
    water, leaves. Another motion replaces the result with evidence from all over the frame, as a mover offers
    the motion of its own part of it: the shift at which the textures correlate best, and motions `doubted` px
    off.

    Args:
        levels: of the keyframe, coarsest first.
        grey: uint8[h, w], the frame, of the finest level's size.
        predictions: keyframe to frame.
        covariance: float64[8, 8], of the step from a prediction, px.
        rest_share: share of the latest frames that the first prediction explained, 0 to 1. It is kept where
            it explains the frame about as well as any motion; the larger the share, the less well is enough.
            None to prefer no prediction.
        doubted: error of the worst corner that the result is tested for, px.

    Source: Black and Anandan, The robust estimation of multiple motions, CVIU 1996; Irani, Rousso and Peleg,
    Computing occluding and transparent motions, IJCV 1994.
    """
    textures = [texture(image) for image in levels_of(grey)]
    finest, image = levels[-1], textures[-1]
    best = _best(levels, textures, predictions, covariance)
    at_rest = rest_share is not None and _is_rest(finest, image, predictions[0], best, rest_share)
    motion = predictions[0] if at_rest else best.motion
    compared = finest.compare(image, motion) if at_rest else best.compared
    neighbours = finest.neighbours(doubted)
    evidence = _evidence(finest, image, motion, compared, neighbours)
    # One frame of movers does not outweigh many at rest.
    needed = _EVIDENT * (1 + rest_share) if at_rest and rest_share is not None else _EVIDENT
    if evidence.min() < -needed:
        start = motion @ neighbours[int(evidence.argmin())]
        moved = _Fit(start, *finest.refine(image, start, start, _RIVAL_COVARIANCE))
        confirmed = _evidence(finest, image, moved.motion, moved.compared, neighbours)
        # Where the scene is hidden, a motion that agrees by chance has better ones beside it, too.
        if confirmed.min() > 0:
            best, at_rest, evidence = moved, False, confirmed
            motion, compared = moved.motion, moved.compared
    return DenseAlignment(
        motion,
        _beyond_chance(finest, image, motion, compared),
        finest.corner_std(best.posterior),
        best.posterior,
        finest.step_of(inverse(best.start) @ motion),
        np.flatnonzero(compared.weights > _AGREEING),
        int(np.count_nonzero(compared.visible)),
        at_rest,
        corner_shift(inverse(predictions[0]) @ best.motion, finest.shape),
        float(np.sqrt(compared.variance)),
        evidence,
    )


def _best(
    levels: Sequence[DenseLevel],
    textures: Sequence[SingleArray],
    predictions: Sequence[FloatArray],
    covariance: FloatArray,
) -> _Fit:
    """The best motion near the predictions, else elsewhere."""
    finest = levels[-1]
    coarsest = 2 ** (len(levels) - 1)
    scores = [
        levels[0].compare(textures[0], to_reduced(prediction, coarsest)).agreement
        for prediction in predictions
    ]
    best = _refined(levels, textures, predictions[int(np.argmax(scores))], covariance)
    shift = from_reduced(levels[0].shift_to(textures[0]), coarsest)
    is_near = float(np.hypot(*shift[:2, 2])) < _FARTHEST * finest.shape[1]
    is_other = corner_shift(inverse(shift) @ best.motion, finest.shape) > ELSEWHERE
    if is_near and is_other and _is_rival(levels[0], textures[0], best.motion, shift, coarsest):
        moved = _refined(levels, textures, shift, _RIVAL_COVARIANCE)
        if finest.evidence(moved.compared, best.compared) > _EVIDENT:
            best = moved
    return best


def _is_rival(
    level: DenseLevel, image: SingleArray, motion: FloatArray, shift: FloatArray, factor: int
) -> bool:
    """Whether the coarsest level agrees more with the motion near a shift than with another.

    Only then are the finer levels, which take most of the time, worth it. Both are in px of the finest one.
    """
    start = to_reduced(shift, factor)
    moved = level.refine(image, start, start, _RIVAL_COVARIANCE / factor**2)[2]
    return level.evidence(moved, level.compare(image, to_reduced(motion, factor))) > 0


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


def _refined(
    levels: Sequence[DenseLevel], textures: Sequence[SingleArray], start: FloatArray, covariance: FloatArray
) -> _Fit:
    """`DenseLevel.refine` from coarse to fine; `start` and `covariance` are in px of the finest level."""
    motion = to_reduced(start, 2 ** len(levels))
    for number, (level, image) in enumerate(zip(levels, textures, strict=True)):
        size = 2 ** (len(levels) - 1 - number)
        motion, posterior, compared = level.refine(
            image, from_reduced(motion, 2), to_reduced(start, size), covariance / size**2
        )
    return _Fit(start, motion, posterior, compared)


def _is_rest(
    finest: DenseLevel, image: SingleArray, prediction: FloatArray, best: _Fit, rest_share: float
) -> bool:
    """Whether a prediction explains the frame about as well as the best motion."""
    allowed = np.linalg.inv(best.posterior + np.diag((_JITTER * STEP_RATIOS) ** 2))
    apart = finest.step_of(inverse(prediction) @ best.motion)
    agreement = finest.compare(image, prediction).agreement
    held, as_good = (low + rest_share * (high - low) for low, high in (_HELD, _AS_GOOD))
    return bool(apart @ allowed @ apart < held and agreement > as_good * best.compared.agreement)
