"""Measuring pictures against key pictures, and choosing which picture becomes one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from streamkit_stitcher.homographies import (
    FloatArray,
    GreyArray,
    inverse,
    normalised,
    overlap,
    scale_change,
)
from streamkit_stitcher.plane.keyframes import (
    LEVELS,
    Keyframe,
    KeyframeMatch,
    KeyframeStore,
    pooled_placement,
)
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.corners import CornerDetector
from streamkit_stitcher.registration.motion_models import FitLimits
from streamkit_stitcher.registration.patches import pyramid

_KEY_POINTS: Final = 400
_TRACKING_POINTS: Final = 100
_POOLED: Final = 4
_POOLED_OVERLAP: Final = 0.25
_LOOK_BACK_MARGIN: Final = 0.1
_LOOK_BACK_TRIES: Final = 2
_SCALE_RANGE: Final = (0.8, 1.25)
_MAX_UNMATCHED: Final = 3


@dataclass(frozen=True, eq=False)
class Anchored:
    """A picture's place after comparison with key pictures.

    Attributes:
        to_reference: float64[3, 3], the picture's pixels to the reference plane.
        measured: whether a key picture was found in it; otherwise the place is the one carried forward.
        jumped: whether another key picture took over, so that the place may step by the drift it corrects.
        keyframe: whether the picture became a key picture.
        matches: patches compared.
        inliers: patches that agree with the place.
        rmse: root mean square distance of the inliers, px.
    """

    to_reference: FloatArray
    measured: bool
    jumped: bool = False
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float = 0.0


class KeyframeAnchor:
    """Holds pictures to the reference plane by the key picture they lie on.

    Args:
        settings: the tracker's settings.
        level: how often pictures are halved for following; sets how far from the carried place to search.
    """

    def __init__(self, settings: PlaneSettings, level: int) -> None:
        self._settings = settings
        self._limits: FitLimits = replace(
            settings.limits, threshold=settings.limits.threshold * 2**level, max_step=1.0
        )
        self._level = level
        self._search_level = max(0, level - 1)
        self._store = KeyframeStore(settings.max_keyframes)
        self._detector = CornerDetector()
        self._active: Keyframe | None = None
        self._unmatched = 0

    def add(self, images: Sequence[GreyArray], to_reference: FloatArray) -> None:
        """Makes a picture the current key picture.

        Args:
            images: the picture and its halvings.
            to_reference: float64[3, 3], its pixels to the reference plane.
        """
        factor = 2**self._level
        corners = self._detector.detect(images[self._level], _KEY_POINTS)
        points = corners * factor + (factor - 1) / 2
        self._active = self._store.add(pyramid(images, LEVELS), points, to_reference)
        self._unmatched = 0

    def place(self, images: Sequence[GreyArray], carried: FloatArray, trusted: bool) -> Anchored:
        """Measures where a picture lies, and makes it a key picture where one is due.

        Args:
            images: the picture and its halvings.
            carried: float64[3, 3], its place by the motion since the last picture.
            trusted: whether that motion was measured by a homography; otherwise the search is wider and the
                carried place is not good enough for a key picture.
        """
        if self._active is None:
            return Anchored(carried, measured=False)
        match = self._match(self._active, images, carried, LEVELS - 1 if not trusted else self._search_level)
        if match is None and trusted:
            match = self._match(self._active, images, carried, LEVELS - 1)
        place = _placed(self._active, match) if match is not None else Anchored(carried, measured=False)
        self._unmatched = 0 if match is not None else self._unmatched + 1
        if match is not None and not self._is_leaving(self._active, place.to_reference):
            return place
        back = self._look_back(self._active, images, place)
        if back is not None:
            return back
        if match is None and (not trusted or self._unmatched < _MAX_UNMATCHED):
            return place
        return self._promote(images, place)

    def _is_leaving(self, keyframe: Keyframe, to_reference: FloatArray) -> bool:
        to_key = normalised(inverse(keyframe.to_reference) @ to_reference)
        scale = scale_change(to_key, keyframe.shape)
        share = overlap(to_key, keyframe.shape)
        return share < self._settings.keyframe_overlap or not _SCALE_RANGE[0] < scale < _SCALE_RANGE[1]

    def _look_back(self, active: Keyframe, images: Sequence[GreyArray], place: Anchored) -> Anchored | None:
        """Lets an earlier key picture take over where the camera has come back to it."""
        least = self._settings.keyframe_overlap + _LOOK_BACK_MARGIN if place.measured else _POOLED_OVERLAP
        found = self._store.overlapping(place.to_reference, active.shape, min(least, 0.95))
        candidates = [keyframe for _, keyframe in found if keyframe is not active]
        for keyframe in candidates[:_LOOK_BACK_TRIES]:
            match = self._match(keyframe, images, place.to_reference, LEVELS - 1)
            if match is not None:
                self._active = keyframe
                self._unmatched = 0
                return replace(_placed(keyframe, match), jumped=True)
        return None

    def _promote(self, images: Sequence[GreyArray], place: Anchored) -> Anchored:
        """Makes the picture a key picture, placed by all key pictures it shares ground with."""
        shape = (images[0].shape[0], images[0].shape[1])
        matches: list[tuple[Keyframe, KeyframeMatch]] = []
        for _, keyframe in self._store.overlapping(place.to_reference, shape, _POOLED_OVERLAP)[:_POOLED]:
            match = self._match(keyframe, images, place.to_reference, self._search_level, _KEY_POINTS)
            if match is not None:
                matches.append((keyframe, match))
        pooled = pooled_placement(matches, shape, self._limits) if matches else None
        if pooled is not None:
            place = Anchored(
                pooled.matrix, True, matches=len(pooled.inliers), inliers=pooled.count, rmse=pooled.rmse
            )
        self.add(images, place.to_reference)
        return replace(place, keyframe=True)

    def _match(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        top_level: int,
        most: int = _TRACKING_POINTS,
    ) -> KeyframeMatch | None:
        frame_to_key = normalised(inverse(keyframe.to_reference) @ to_reference)
        return self._store.match(
            keyframe,
            pyramid(images, top_level + 1),
            frame_to_key,
            self._limits,
            top_level=top_level,
            max_points=most,
        )


def _placed(keyframe: Keyframe, match: KeyframeMatch) -> Anchored:
    return Anchored(
        normalised(keyframe.to_reference @ match.fit.matrix),
        measured=True,
        matches=len(match.fit.inliers),
        inliers=match.fit.count,
        rmse=match.fit.rmse,
    )
