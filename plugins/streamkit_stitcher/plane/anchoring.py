"""Measuring pictures against key pictures, and choosing which picture becomes one."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    corner_shift,
    inverse,
    normalised,
    overlap,
    scale_change,
    tilt,
)
from streamkit_stitcher.plane.following import KeyframeFollower, following_level
from streamkit_stitcher.plane.graph import Tie
from streamkit_stitcher.plane.key_picture import LEVELS
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import (
    Keyframe,
    KeyframeMatch,
    KeyframeMatcher,
    pooled_placement,
)
from streamkit_stitcher.plane.loop_closure import Recogniser, better, tie_of
from streamkit_stitcher.plane.placement import Anchored
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.descriptors import Description, describe
from streamkit_stitcher.registration.motion_models import FitLimits, MotionModel
from streamkit_stitcher.registration.patches import pyramid

_POOLED_POINTS: Final = 250
_POOLED: Final = 4
_POOLED_OVERLAP: Final = 0.25
_LOOK_BACK_MARGIN: Final = 0.1
_LOOK_BACK_TRIES: Final = 2
_RECOGNISED: Final = 3
_PLANE_STEP: Final = 1.0
_SCALE_RANGE: Final = (0.8, 1.25)
# A picture that is seen much more aslant than the key picture is a key picture itself.
_MOST_TILT: Final = 0.5
_MAX_UNMATCHED: Final = 3
_MAX_DOUBTED: Final = 12
# A picture out of focus makes a poor key picture: the next one may be sharp.
_BLURRED_MARGIN: Final = 0.15
_FOLLOW_LEVEL: Final = 1
_FOLLOW_POINTS: Final = 48


class KeyframeAnchor:
    """Holds pictures to the reference plane by the key picture they lie on.

    Args:
        settings: the tracker's settings.
        level: how often pictures are halved for following; sets how far from the carried place to search.

    Attributes:
        keyframes: the key pictures of the plane.
    """

    def __init__(self, settings: PlaneSettings, level: int) -> None:
        self._settings = settings
        self._limits: FitLimits = replace(
            settings.limits, threshold=settings.limits.threshold * 2**level, max_step=1.0
        )
        self._level = level
        self._search_level = max(0, level - 1)
        self.keyframes = KeyframeMap(settings)
        self._follower = KeyframeFollower()
        self._matcher = KeyframeMatcher()
        self._recogniser = Recogniser()
        self._described: Description | None = None
        self._unmatched = 0
        self._is_carried_surely = True

    def add(
        self, images: Sequence[GreyArray], to_reference: FloatArray, ties: Sequence[Tie] = ()
    ) -> Keyframe:
        """Makes a picture the current key picture.

        Args:
            images: the picture and its halvings.
            to_reference: float64[3, 3], its pixels to the reference plane.
            ties: to earlier key pictures, with any observer.
        """
        keyframe = self.keyframes.add(images, to_reference, self._level, ties)
        self._follower.expect(keyframe, self.keyframes.beside)
        if self._described is not None:
            self._recogniser.remember(keyframe, self._described)
        self._unmatched = 0
        self._is_carried_surely = True
        return keyframe

    def follow(self, images: Sequence[GreyArray], expected: FloatArray) -> KeyframeMatch | None:
        """Looks for the current key picture near the expected place.

        Args:
            images: the picture and its halvings.
            expected: float64[3, 3], its place if the camera goes on as it did.
        """
        active = self.keyframes.active
        if active is None:
            return None
        match = self._sure(self._follow(active, images, expected, self._settings.max_points))
        if match is not None:
            if self.keyframes.rule.model is not MotionModel.HOMOGRAPHY is match.fit.model:
                self.keyframes.learn(match)
            return match
        return self._sure(self._match(active, images, expected, _FOLLOW_LEVEL, coarse=_FOLLOW_POINTS))

    def recognise(self, small: GreyArray) -> KeyframeMatch | None:
        """Looks for a picture of unknown motion in the newest key pictures, by what it shows.

        The one in which it is seen becomes the current one.

        Args:
            small: uint8[h, w], the picture at working size.
        """
        active = self.keyframes.active
        if active is None:
            return None
        description = self._described = describe(small)
        recent = [keyframe for keyframe in self.keyframes.stored if keyframe.index != active.index]
        for keyframe in [active, *recent[::-1][: _RECOGNISED - 1]]:
            seen = self._recogniser.place(description, keyframe)
            if seen is not None:
                self.keyframes.activate(keyframe)
                return seen
        return None

    def place(
        self,
        images: Sequence[GreyArray],
        carried: FloatArray,
        trusted: bool,
        followed: KeyframeMatch | None = None,
        seen: KeyframeMatch | None = None,
        due: bool = False,
        leaped: bool = False,
    ) -> Anchored:
        """Measures where a picture lies, and makes it a key picture where one is due.

        Args:
            images: the picture and its halvings.
            carried: float64[3, 3], its place by the motion since the last picture.
            trusted: whether that motion was measured by a homography; otherwise the search is wider and the
                carried place is not good enough for a key picture.
            followed: what `follow` found, which saves the search.
            seen: what `recognise` found, from where the search begins.
            due: whether it should become a key picture in any case.
            leaped: whether a picture that was recognised follows the one before without a gap, as photographs
                do: it is then placed by what little they share, and not sure.
        """
        if seen is None:
            self._described = None
        active = self.keyframes.active
        if active is None:
            return Anchored(carried, measured=False)
        match = followed
        if seen is not None:
            carried = normalised(active.to_reference @ seen.fit.matrix)
            match, carried = self._recognised(active, images, carried, seen, leaped)
        elif match is None:
            level = self._search_level if trusted else LEVELS - 1
            match = self._sure(self._follow(active, images, carried, self._settings.max_points))
            match = match or self._sure(self._match(active, images, carried, level))
            if match is None and trusted:
                match = self._sure(self._match(active, images, carried, LEVELS - 1))
        sure = seen is None or self._sure(match) is not None
        sure = sure and (match is None or match.clear)
        place = _placed(active, match) if match is not None else Anchored(carried, measured=False)
        place = replace(place, sure=sure)
        self._unmatched = 0 if match is not None else self._unmatched + 1
        self._is_carried_surely = match is not None or (trusted and seen is None and self._is_carried_surely)
        least = self._settings.keyframe_overlap
        if match is not None and not match.clear:
            least -= _BLURRED_MARGIN
        leaving = self._is_leaving(active, place.to_reference, least)
        if match is not None and not due and not leaving:
            return place
        back = None if due or seen is not None else self._look_back(active, images, place)
        if back is not None:
            return back
        # Where the key picture should be seen but is not, this one is rather to blame than the ground; where
        # the motion since it was seen is a guess, a later picture may be found on it.
        patience = _MAX_UNMATCHED if leaving and self._is_carried_surely else _MAX_DOUBTED
        if match is None and (not trusted or self._unmatched < patience):
            return place
        return self._promote(images, place, None if match is None else (active, match))

    def _recognised(
        self,
        active: Keyframe,
        images: Sequence[GreyArray],
        carried: FloatArray,
        seen: KeyframeMatch,
        leaped: bool,
    ) -> tuple[KeyframeMatch | None, FloatArray]:
        """A match that tells where all of a recognised picture lies, and the likeliest place.

        Returns:
            The match, None where there is no such one and the camera did not leap; and the place.
        """
        aligned = self._sure(self._follow(active, images, carried, self._settings.max_points))
        aligned = aligned or self._match(active, images, carried, LEVELS - 1)
        best = better(seen, aligned, active, self._settings.max_points)
        found = self._sure(best) or self._sure(aligned) or (best if leaped else None)
        if found is None and aligned is not None and aligned.deviation < seen.deviation:
            carried = normalised(active.to_reference @ aligned.fit.matrix)
        return found, carried

    def _is_leaving(self, keyframe: Keyframe, to_reference: FloatArray, least: float) -> bool:
        to_key = normalised(inverse(keyframe.to_reference) @ to_reference)
        scale = scale_change(to_key, keyframe.shape)
        share = overlap(to_key, keyframe.shape)
        tilted = tilt(to_key, keyframe.shape) > _MOST_TILT
        return share < least or tilted or not _SCALE_RANGE[0] < scale < _SCALE_RANGE[1]

    def _look_back(self, active: Keyframe, images: Sequence[GreyArray], place: Anchored) -> Anchored | None:
        """Lets an earlier key picture take over where the camera has come back to it."""
        least = self._settings.keyframe_overlap + _LOOK_BACK_MARGIN if place.measured else _POOLED_OVERLAP
        found = self.keyframes.overlapping(place.to_reference, active.shape, min(least, 0.95))
        candidates = [keyframe for _, keyframe in found if keyframe.index != active.index]
        for keyframe in candidates[:_LOOK_BACK_TRIES]:
            match = self._sure(
                self._follow(keyframe, images, place.to_reference, self._settings.max_points)
                or self._match(keyframe, images, place.to_reference, LEVELS - 1)
            )
            if match is not None:
                self.keyframes.activate(keyframe)
                self._unmatched = 0
                back = _placed(keyframe, match)
                return replace(back, change=normalised(back.to_reference @ inverse(place.to_reference)))
        return None

    def _promote(
        self, images: Sequence[GreyArray], place: Anchored, known: tuple[Keyframe, KeyframeMatch] | None
    ) -> Anchored:
        """Makes the picture a key picture, placed by all key pictures it shares ground with.

        Args:
            images: the picture and its halvings.
            place: where it lies.
            known: the key picture it was measured against, which counts where it is not matched better.
        """
        sure = place.sure
        change = self.keyframes.adopt() if self.keyframes.is_adjusting else None
        if change is not None:
            place = replace(place, to_reference=normalised(change @ place.to_reference))
        shape = (images[0].shape[0], images[0].shape[1])
        matches: list[tuple[Keyframe, KeyframeMatch]] = []
        for _, keyframe in self.keyframes.overlapping(place.to_reference, shape, _POOLED_OVERLAP)[:_POOLED]:
            if known is not None and known[0].index == keyframe.index and known[1].variances is not None:
                match: KeyframeMatch | None = known[1]
            else:
                match = self._follow(keyframe, images, place.to_reference, _POOLED_POINTS) or self._match(
                    keyframe, images, place.to_reference, self._search_level, _POOLED_POINTS
                )
            if match is not None:
                matches.append((keyframe, match.firmest()))
                self.keyframes.learn(match)
        pooled = None
        if known is not None and known[0].index not in {keyframe.index for keyframe, _ in matches}:
            matches.append((self.keyframes.current(known[0]), known[1].firmest()))
            self.keyframes.learn(known[1])
        elif len(matches) == 1:
            # Its fit knows how well each of its patches is placed.
            place = _placed(*matches[0])
        elif matches:
            pooled = pooled_placement(matches, shape, self._limits, self.keyframes.rule)
        if pooled is not None:
            step = normalised(inverse(place.to_reference) @ pooled.matrix)
            if place.measured and corner_shift(step, shape) > _PLANE_STEP:
                # Not the picture moved: its key pictures contradict each other.
                moved = normalised(pooled.matrix @ inverse(place.to_reference))
                change = moved if change is None else normalised(moved @ change)
            place = Anchored(
                pooled.matrix, True, matches=len(pooled.inliers), inliers=pooled.count, rmse=pooled.rmse
            )
        self.add(images, place.to_reference, [tie_of(keyframe, 0, match) for keyframe, match in matches])
        return replace(place, keyframe=True, change=change, sure=sure)

    def _sure(self, match: KeyframeMatch | None) -> KeyframeMatch | None:
        """A match that tells where the whole picture lies, not only the part with the patches."""
        return match if match is not None and match.deviation <= self._limits.threshold else None

    def begin_adjustment(self, images: Sequence[GreyArray], whole: bool = False) -> None:
        """Begins the adjustment that a new key picture makes due, see `KeyframeMap.begin_adjustment`."""
        self.keyframes.begin_adjustment(images, self._described, whole)

    def _follow(
        self, keyframe: Keyframe, images: Sequence[GreyArray], to_reference: FloatArray, most: int
    ) -> KeyframeMatch | None:
        return self._follower.follow(
            keyframe,
            pyramid(images, following_level(keyframe.shape) + 2),
            normalised(inverse(keyframe.to_reference) @ to_reference),
            self._limits,
            most,
            self.keyframes.rule,
        )

    def _match(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        top_level: int,
        most: int = 0,
        coarse: int = 96,
    ) -> KeyframeMatch | None:
        return self._matcher.match(
            keyframe,
            pyramid(images, top_level + 1),
            normalised(inverse(keyframe.to_reference) @ to_reference),
            self._limits,
            top_level=top_level,
            max_points=most or self._settings.max_points,
            rule=self.keyframes.rule,
            coarse_points=coarse,
        )


def _placed(keyframe: Keyframe, match: KeyframeMatch) -> Anchored:
    return Anchored(
        normalised(keyframe.to_reference @ match.fit.matrix),
        measured=True,
        matches=len(match.fit.inliers),
        inliers=match.fit.count,
        rmse=match.fit.rmse,
    )
