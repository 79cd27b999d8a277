"""Key pictures kept as small patches, and the placing of later pictures against them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    centre,
    corners,
    from_reduced,
    inverse,
    is_plausible,
    overlap,
    project,
    scale_change,
    translation,
)
from streamkit_stitcher.plane.key_picture import KeyPicture, at_level
from streamkit_stitcher.registration.gauss_newton import corner_deviation
from streamkit_stitcher.registration.model_selection import ANY_MOTION, MotionRule
from streamkit_stitcher.registration.motion_models import (
    FitLimits,
    MotionFit,
    MotionModel,
    fit_homography,
)
from streamkit_stitcher.registration.patches import (
    Alignment,
    PatchLevel,
    align,
    prepare,
    reduced_motion,
)

_PREPARED: Final = 12
_COARSE_POINTS: Final = 96
_COARSE_INLIERS: Final = 12
_SCALE_RANGE: Final = (0.7, 1.4)
_COARSE_THRESHOLD: Final = 1.5
_COARSE_TOLERANCE: Final = 0.2
_FINE_TOLERANCE: Final = 0.1
ANY_STEP: Final = 10.0
_WIDE_OVERLAP: Final = 0.8
# What no patch is better than, px: the lens, the shutter, the ground are not quite a plane's.
_FLOOR: Final = 0.04
_MANY: Final = 60
_TRIM: Final = 9.0


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A key picture, and where it lies.

    Attributes:
        index: number of the key picture, never reused.
        to_reference: float64[3, 3], full-size pixels to the reference plane.
        shape: (height, width) of the picture, px.
        factor: the reduction of `small`.
        content: what is kept of its pixels; waits until that is worked out.
    """

    index: int
    to_reference: FloatArray
    shape: tuple[int, int]
    factor: int
    content: Callable[[], KeyPicture]

    @property
    def points(self) -> FloatArray:
        """float64[n, 2], patch centres, full-size px."""
        return self.content().points

    @property
    def patches(self) -> tuple[GreyArray, ...]:
        """One uint8[n, 17, 17] per pyramid level, finest first."""
        return self.content().patches

    @property
    def small(self) -> GreyArray:
        """uint8[h, w], the picture at working size, to recognise it by."""
        return self.content().small


@dataclass(frozen=True, eq=False)
class KeyframeMatch:
    """A picture placed on a key picture.

    Attributes:
        fit: the homography from the picture's pixels to the key picture's, with its inliers.
        frame_points: float64[n, 2], the inliers in the picture, px.
        key_points: float64[n, 2], the same ground in the key picture, px.
        patches: int64[n], the key picture's patches they are.
        deviation: how far off the fit may put the worst corner of the picture, one standard deviation, px.
        variances: float64[n], how badly each patch is placed, in any unit, infinite for those off the plane;
            None where nobody knows.
        clear: whether most patches agree or look much like those of the key picture.
    """

    fit: MotionFit
    frame_points: FloatArray
    key_points: FloatArray
    patches: npt.NDArray[np.int64]
    deviation: float = 0.0
    variances: FloatArray | None = None
    clear: bool = True

    def on_plane(self) -> "KeyframeMatch":
        """The same without the patches off the plane."""
        return self if self.variances is None else self._part(np.flatnonzero(np.isfinite(self.variances)))

    def firmest(self) -> "KeyframeMatch":
        """The same with the better placed half of the patches on the plane, if there are many."""
        firm = self.on_plane()
        if firm.variances is None or len(firm.patches) <= _MANY:
            return firm
        best = np.argsort(firm.variances, kind="stable")[: max(_MANY, len(firm.patches) // 2)]
        return firm._part(np.sort(best))

    def _part(self, kept: npt.NDArray[np.int64]) -> "KeyframeMatch":
        if len(kept) == len(self.patches):
            return self
        return replace(
            self,
            frame_points=self.frame_points[kept],
            key_points=self.key_points[kept],
            patches=self.patches[kept],
            variances=None if self.variances is None else self.variances[kept],
        )


class KeyframeStore:
    """A bounded set of key pictures of one reference plane.

    When it is full, of the two key pictures that lie nearest to each other the older one goes: ground seen
    twice is what a later look back misses least.
    """

    def __init__(self, capacity: int = 128) -> None:
        self._capacity = capacity
        self._keyframes: list[Keyframe] = []
        self._next_index = 0

    def __len__(self) -> int:
        return len(self._keyframes)

    @property
    def keyframes(self) -> tuple[Keyframe, ...]:
        """The stored key pictures, oldest first."""
        return tuple(self._keyframes)

    def add(
        self, content: Callable[[], KeyPicture], to_reference: FloatArray, shape: tuple[int, int], level: int
    ) -> Keyframe:
        """Stores a key picture.

        Args:
            content: gives what is kept of its pixels.
            to_reference: float64[3, 3], its full-size pixels to the reference plane.
            shape: (height, width) of the picture, px.
            level: how often it was halved to working size.

        Returns:
            The stored key picture.
        """
        keyframe = Keyframe(self._next_index, to_reference, shape, 2**level, content)
        self._next_index += 1
        self._keyframes.append(keyframe)
        if len(self._keyframes) > self._capacity:
            self._keyframes.pop(self._most_redundant())
        return keyframe

    def overlapping(
        self, to_reference: FloatArray, shape: tuple[int, int], least: float
    ) -> list[tuple[float, Keyframe]]:
        """Key pictures that share ground with a picture at a similar scale, greatest overlap first.

        Args:
            to_reference: float64[3, 3], where the picture is thought to lie.
            shape: (height, width) of the picture, px.
            least: smallest overlap to report, 0 to 1.
        """
        found = []
        for keyframe in self._near(to_reference, shape, least):
            to_key = inverse(keyframe.to_reference) @ to_reference
            share = overlap(to_key, shape)
            if share >= least and _SCALE_RANGE[0] < scale_change(to_key, shape) < _SCALE_RANGE[1]:
                found.append((share, keyframe))
        return sorted(found, key=lambda item: (-item[0], item[1].index))

    def _near(self, to_reference: FloatArray, shape: tuple[int, int], least: float) -> list[Keyframe]:
        """Key pictures whose overlap with a picture is `least` or more as far as upright boxes can tell.

        All at once, as most of a hundred are far away and to measure each takes a tenth of a millisecond.
        """
        if not self._keyframes:
            return []
        places = np.stack([keyframe.to_reference for keyframe in self._keyframes])
        outline = np.concatenate([corners(shape), np.ones((4, 1))], axis=1)
        try:
            mapped = np.linalg.solve(places, (to_reference @ outline.T)[np.newaxis]).transpose(0, 2, 1)
        except np.linalg.LinAlgError:
            return self._keyframes
        depths = mapped[:, :, 2]
        in_front = np.abs(np.sign(depths).sum(axis=1)) == len(outline)
        points = mapped[:, :, :2] / np.where(in_front[:, np.newaxis], depths, 1.0)[:, :, np.newaxis]
        x, y = points[:, :, 0], points[:, :, 1]
        after = np.roll(points, -1, axis=1)
        area = np.abs((x * after[:, :, 1] - y * after[:, :, 0]).sum(axis=1)) / 2
        ends = np.array([shape[1] - 1, shape[0] - 1])
        sides = np.minimum(points.max(axis=1), ends) - np.maximum(points.min(axis=1), 0.0)
        shared = np.maximum(sides, 0.0).prod(axis=1)
        near = ~in_front | (shared >= 0.99 * least * area)
        return [keyframe for keyframe, kept in zip(self._keyframes, near, strict=True) if kept]

    def move(self, places: Mapping[int, FloatArray]) -> None:
        """Gives key pictures other places, by their indices."""
        self._keyframes = [
            replace(keyframe, to_reference=places[keyframe.index]) if keyframe.index in places else keyframe
            for keyframe in self._keyframes
        ]

    def _most_redundant(self) -> int:
        """Index of the older of the two nearest key pictures; the newest and the first always stay."""
        places = np.array(
            [project(item.to_reference, centre(item.shape)[np.newaxis])[0] for item in self._keyframes]
        )
        distances = np.hypot(*(places[:, np.newaxis] - places[np.newaxis]).transpose(2, 0, 1))
        distances[np.tril_indices(len(places))] = np.inf
        distances[0] = np.inf
        return int(np.unravel_index(int(np.argmin(distances)), distances.shape)[0])


class KeyframeMatcher:
    """Places pictures on key pictures; keeps what it worked out of the last few key pictures."""

    def __init__(self) -> None:
        self._prepared: dict[tuple[int, int, int], tuple[PatchLevel, npt.NDArray[np.int64]]] = {}

    def match(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        frame_to_key: FloatArray,
        limits: FitLimits,
        *,
        top_level: int,
        max_points: int,
        rule: MotionRule = ANY_MOTION,
        coarse_points: int = _COARSE_POINTS,
    ) -> KeyframeMatch | None:
        """Places a picture on a key picture to sub-pixel accuracy.

        Args:
            keyframe: the key picture.
            images: the picture and its halvings.
            frame_to_key: float64[3, 3], predicted motion, right to about 3 * 2**top_level px.
            limits: what the homography must reach; its threshold counts in full-size px.
            top_level: the coarsest level to start from, 0 for full size only.
            max_points: patches to use, spread evenly over the key picture; fewer at the coarse levels.
            rule: what the motion may be.
            coarse_points: patches to use at half size.

        Returns:
            The match, or None when too few patches agree.
        """
        top_level = min(top_level, len(images) - 1, len(keyframe.patches) - 1)
        key_to_frame = inverse(frame_to_key)
        if overlap(frame_to_key, keyframe.shape) < _WIDE_OVERLAP:
            # About as many are in view as otherwise; the corners beyond them need them most.
            max_points += max_points // 2
        for level in range(top_level, -1, -1):
            patches, chosen = self._level(keyframe, level, coarse_points if level == 1 else max_points)
            expected = reduced_motion(key_to_frame, level)
            tolerance = _COARSE_TOLERANCE if level else _FINE_TOLERANCE
            found = align(patches, images[level], expected, tolerance)
            if level == 0:
                return _accepted(found, chosen, keyframe.shape, limits, rule, inverse(key_to_frame))
            start = _shifted(expected, found.key_points, found.frame_points)
            coarse = fit_homography(found.key_points, found.frame_points, _COARSE_THRESHOLD, start=start)
            if (
                coarse is not None
                and coarse.count >= min(limits.min_inliers, _COARSE_INLIERS)
                and coarse.count >= limits.min_ratio * found.sought
                and is_plausible(coarse.matrix, keyframe.shape, ANY_STEP)
            ):
                key_to_frame = from_reduced(coarse.matrix, 2**level)
        return None

    def _level(self, keyframe: Keyframe, level: int, most: int) -> tuple[PatchLevel, npt.NDArray[np.int64]]:
        """At most `most` patches of a level, and their indices."""
        key = (keyframe.index, level, most)
        prepared = self._prepared.pop(key, None)
        if prepared is None:
            chosen = _spread(len(keyframe.points), most)
            points = at_level(keyframe.points[chosen], level)
            prepared = prepare(keyframe.patches[level][chosen], points), chosen
        self._prepared[key] = prepared
        if len(self._prepared) > _PREPARED:
            del self._prepared[next(iter(self._prepared))]
        return prepared


def pooled_placement(
    matches: Sequence[tuple[Keyframe, KeyframeMatch]],
    shape: tuple[int, int],
    limits: FitLimits,
    rule: MotionRule = ANY_MOTION,
) -> MotionFit | None:
    """Places a picture on the reference plane by its matches with several key pictures at once.

    Args:
        matches: key pictures with the picture's match on each.
        shape: (height, width) of the picture, px.
        limits: what the homography must reach; its threshold counts in px of the picture.
        rule: what the motion may be.

    Returns:
        The homography from the picture's pixels to the reference plane, fitted so that the error counts in
        the picture's pixels, or None when the matches do not agree.
    """
    plane = np.concatenate([project(keyframe.to_reference, match.key_points) for keyframe, match in matches])
    frame = np.concatenate([match.frame_points for _, match in matches])
    fit = fit_homography(plane, frame, limits.threshold)
    if fit is None or fit.count < limits.min_inliers or fit.ratio < limits.min_ratio:
        return None
    fit = rule.applied(fit, plane, frame)
    return replace(fit, matrix=inverse(fit.matrix)) if scale_change(inverse(fit.matrix), shape) > 0 else None


def _shifted(expected: FloatArray, source: FloatArray, target: FloatArray) -> FloatArray:
    """An expected motion, source to target, moved by the points' median distance from it."""
    if not len(source):
        return expected
    apart = target - project(expected, source)
    return translation(np.partition(apart, len(apart) // 2, axis=0)[len(apart) // 2]) @ expected


def _spread(count: int, most: int) -> npt.NDArray[np.int64]:
    if count <= most:
        return np.arange(count)
    return np.linspace(0, count - 1, most).astype(np.int64)


def _accepted(
    found: Alignment,
    chosen: npt.NDArray[np.int64],
    shape: tuple[int, int],
    limits: FitLimits,
    rule: MotionRule,
    start: FloatArray,
) -> KeyframeMatch | None:
    """The match that the patches agree on, or None.

    Where the ground is not, a sixth of the patches still settle somewhere near, and nearly all of these agree
    with a homography: what counts is how many of the patches in view agree, not of those that settled.
    """
    frame_points, key_points = found.frame_points, found.key_points
    weights = 1 / (found.variances + _FLOOR**2)
    fit = fit_homography(frame_points, key_points, limits.threshold, start=start, weights=weights)
    if fit is None or fit.count < max(limits.min_inliers, limits.min_ratio * found.sought):
        return None
    fit = rule.applied(fit, frame_points, key_points)
    if not is_plausible(fit.matrix, shape, ANY_STEP):
        return None
    patches = chosen[found.patches[fit.inliers]]
    seen = frame_points[fit.inliers]
    freedom = 8 if fit.model is MotionModel.HOMOGRAPHY else 6
    deviation = corner_deviation(fit.matrix, seen, fit.rmse, shape, freedom)
    apart = project(fit.matrix, seen) - key_points[fit.inliers]
    squares = np.einsum("ni,ni->n", apart, apart) * weights[fit.inliers]
    off_plane = squares > _TRIM * np.median(squares)
    variances = np.where(off_plane, np.inf, found.variances[fit.inliers])
    return KeyframeMatch(fit, seen, key_points[fit.inliers], patches, deviation, variances)
