"""Places frames by keyframes, and chooses new keyframes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from streamkit.geometry.homography import FloatArray, GreyArray, corner_shift, inverse, normalised
from streamkit_stitcher.plane.dense_matching import DenseMatcher
from streamkit_stitcher.plane.feature_matching import likeliest, match_by_features
from streamkit_stitcher.plane.frame_registration import OK_STD
from streamkit_stitcher.plane.keyframe_content import scene_level
from streamkit_stitcher.plane.keyframe_graph import Tie
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch, is_leaving
from streamkit_stitcher.plane.loop_closure import tie_of
from streamkit_stitcher.plane.patch_matching import PatchMatcher
from streamkit_stitcher.plane.placement import Placement, placed
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.dense_alignment import MIN_AGREEMENT
from streamkit_stitcher.registration.descriptors import FrameFeatures, describe
from streamkit_stitcher.registration.motion_models import MotionModel

# Patches that agree, as a part of those in view, which no mover can outvote.
_DOMINANT: Final = 0.75
# Share of the contrast that agrees with the keyframe above which nothing else is tried. Between the least and
# this, as after motion blur, the tilt may be wrong.
SURE_SHARE: Final = 0.2
# The motion of the corners replaces the expected one where so many times more of the area agrees with it.
_MIN_SHARE_RATIO: Final = 2.0
# A new keyframe is tied to the keyframes that it overlaps most, this many, by at least this part.
_TIED: Final = 4
_TIED_OVERLAP: Final = 0.25
_TIED_POINTS: Final = 250
# An earlier keyframe takes over where it overlaps this much more than a new one would be needed for.
_REVISIT_MARGIN: Final = 0.1
_REVISIT_TRIES: Final = 2
# Frames on a doubtful keyframe after which features of the others are compared.
_RETURN_PERIOD: Final = 16
_RELOCALISED: Final = 3
# Frames without a match after which one becomes a keyframe: where the camera leaves the keyframe, and else.
_MAX_UNMATCHED: Final = 3
_MAX_DOUBTFUL: Final = 12
# Predicted error of a keyframe, px, that the frames measured against it leave out: it makes one at the limit
# of `OK_STD` an eighth less precise. Those of good keyframes would add up over a flight.
_MAX_FORGOTTEN_STD: Final = 0.5 * OK_STD


class KeyframeAnchor:
    """Places frames on the reference plane by keyframes. All homographies given are to the plane.

    Args:
        settings: of the registration.
        level: how often frames are halved to working size.
        plane: number of the first plane.

    Attributes:
        keyframes: the keyframes of all planes.
        features: features of the last frame, where it was relocalised.
        is_video: whether the frames are those of a video.
    """

    def __init__(self, settings: PlaneSettings, level: int, plane: int = 0) -> None:
        self._settings = settings
        threshold = settings.limits.ransac_threshold * 2**level
        self._limits = replace(settings.limits, ransac_threshold=threshold)
        self._level = level
        self.keyframes = KeyframeMap(settings, plane)
        self._patches = PatchMatcher()
        self._dense = DenseMatcher()
        self.features: FrameFeatures | None = None
        self.is_video = False
        self._unmatched = self._doubtful_frames = 0
        self._is_prediction_reliable = True

    def add(
        self,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        ties: Sequence[Tie] = (),
        corner_std: float = 0.0,
    ) -> None:
        """Makes a frame the current keyframe; the ties to earlier keyframes may name any observer."""
        self.keyframes.add(images, to_reference, self._level, ties, corner_std, self.features, self.is_video)
        self._unmatched = self._doubtful_frames = 0
        self._is_prediction_reliable = True

    def match_near(
        self, images: Sequence[GreyArray], before: FloatArray, before_std: float, expected: FloatArray
    ) -> KeyframeMatch | None:
        """The match with the current keyframe, by patches where most of them agree, else by the area.

        Its `share` is small where next to nothing agrees.

        Args:
            images: the frame and its halvings.
            before: the previous frame.
            before_std: its predicted error, px.
            expected: the predicted homography.
        """
        active = self.keyframes.active
        match = self._match_whole(active, images, expected)
        if match is not None:
            if self.keyframes.rule.model is not MotionModel.HOMOGRAPHY is match.fit.model:
                self.keyframes.learn(match)
            if match.share >= _DOMINANT:
                return match
        small = images[self._level]
        if active.small.shape != small.shape:
            return match
        to_key, std = inverse(active.to_reference), self._std_to_active(before_std)
        near = self._dense.match(
            active, small, normalised(to_key @ before), std, normalised(to_key @ expected)
        )
        if match is None:
            return near
        # Neither way is sure where the two disagree.
        apart = corner_shift(inverse(match.fit.matrix) @ near.fit.matrix, active.shape)
        return replace(near, corner_std=math.hypot(near.corner_std, apart / 2))

    def place(
        self,
        images: Sequence[GreyArray],
        near: KeyframeMatch | None,
        predicted: Placement,
        before_std: float,
        is_photograph: bool,
    ) -> Placement:
        """Places a frame by patches of the current keyframe near a prediction, by its area, or as predicted.

        Movers may win among the corners: these only propose a motion, which replaces `near` where much more
        of the area agrees with it. A frame of a video that the current keyframe does not match may show an
        earlier one. Photographs that the patches do not match are left to features.

        Args:
            images: the frame and its halvings.
            near: result of `match_near`; None where that was not tried.
            predicted: where the corners lead.
            before_std: predicted error of the previous frame, px.
            is_photograph: whether the frame does not continue a video.
        """
        active = self.keyframes.active
        match = self._match_whole(active, images, predicted.to_reference)
        if match is not None:
            return placed(active, match)
        if is_photograph:
            return predicted
        if near is not None and predicted.is_trusted:
            to_key = normalised(inverse(active.to_reference) @ predicted.to_reference)
            std = self._std_to_active(before_std)
            proposed = self._dense.match_from(active, images[self._level], to_key, std)
            near = proposed if proposed.share > _MIN_SHARE_RATIO * near.share else near
        if near is not None and near.share >= MIN_AGREEMENT:
            return placed(active, near)
        return self._revisit(images, predicted) or predicted

    def recognise(self, images: Sequence[GreyArray], is_previous_known: bool) -> Placement | None:
        """Places a frame of unknown motion by features of the newest keyframes, then of the likeliest.

        The matching keyframe becomes current, and its plane, too. A frame of a video continues another plane
        only where it is `ok` there; else it is elsewhere: it starts a plane, which ties may join to that one.

        Args:
            images: the frame and its halvings.
            is_previous_known: whether the previous frame had a place.
        """
        features = self.features = self._describe(images)
        active = self.keyframes.active
        stored = [active, *(one for one in self.keyframes.stored[::-1] if one.index != active.index)]
        # What matches a doubtful keyframe has a doubtful place.
        stored.sort(key=lambda one: one.corner_std > OK_STD)
        recent, older = stored[:_RELOCALISED], stored[_RELOCALISED:]
        other = None
        for candidates in (recent, likeliest(features, older, _RELOCALISED)):
            for keyframe in candidates:
                match = match_by_features(features, keyframe)
                if match is None:
                    continue
                is_elsewhere = keyframe.plane != self.keyframes.plane
                found = self._place_recognised(images, keyframe, match, is_previous_known or is_elsewhere)
                if not (is_elsewhere and self.is_video and found.std > OK_STD):
                    self.keyframes.activate(keyframe)
                    return found
                other = replace(found, match=None, is_recognised=False, is_elsewhere=True)
        return other

    def _place_recognised(
        self, images: Sequence[GreyArray], keyframe: Keyframe, recognised: KeyframeMatch, is_jump: bool
    ) -> Placement:
        """Places a frame that features have matched, more precisely by patches.

        A match that does not fix the whole frame is a prediction only, unless the camera jumps, as from one
        photograph to the next, whose overlap is small.
        """
        match = self._match(keyframe, images, placed(keyframe, recognised).to_reference) or recognised
        found = replace(placed(keyframe, match), is_recognised=True)
        is_whole = match.deviation <= self._limits.ransac_threshold
        return found if is_jump or is_whole else replace(found, match=None)

    def keep(self, images: Sequence[GreyArray], found: Placement) -> Placement:
        """Makes a placed frame a keyframe, or an earlier keyframe current, where that is needed."""
        # Fields that jump apart show no place, and would hand on their error; a later frame may be better.
        is_certain = found.match is not None and found.match.share >= SURE_SHARE
        is_certain = is_certain and found.field_error <= OK_STD
        if not found.is_recognised:
            self.features = None
        if found.change is not None:
            return found
        active = self.keyframes.active
        if active.corner_std > OK_STD and found.match is not None:
            returned = self._return(images, found)
            if returned is not None:
                return returned
        self._unmatched = 0 if is_certain else self._unmatched + 1
        self._is_prediction_reliable = is_certain or (found.is_trusted and self._is_prediction_reliable)
        leaving = is_leaving(active, found.to_reference, found.match, self._settings.keyframe_overlap)
        if found.match is not None and not found.is_due and not leaving:
            return found
        if is_certain and not (found.is_due or found.is_recognised):
            revisited = self._revisit(images, found)
            if revisited is not None:
                return revisited
        # An unmatched frame that should overlap its keyframe is probably at fault itself; after an unreliable
        # prediction, a later frame may match the keyframe.
        patience = _MAX_UNMATCHED if leaving and self._is_prediction_reliable else _MAX_DOUBTFUL
        is_usable = (found.match is not None or found.is_trusted) and not found.is_adrift
        if not is_certain and (not is_usable or self._unmatched < patience):
            return found
        return self._promote(images, found)

    def _describe(self, images: Sequence[GreyArray]) -> FrameFeatures:
        level = scene_level(images[0].shape, self.is_video)
        return describe(images[level], 2**level)

    def _std_to_active(self, std: float) -> float:
        """A predicted error, px, without that of the current keyframe itself."""
        return math.sqrt(max(0.0, std**2 - self.keyframes.active.corner_std**2))

    def _match(
        self, keyframe: Keyframe, images: Sequence[GreyArray], to_reference: FloatArray, most: int = 0
    ) -> KeyframeMatch | None:
        """Matches at most `most` patches (0: all) near where a homography expects them."""
        to_key = normalised(inverse(keyframe.to_reference) @ to_reference)
        points = most or self._settings.max_points
        return self._patches.match(keyframe, images, to_key, self._limits, points, self.keyframes.rule)

    def _match_whole(
        self, keyframe: Keyframe, images: Sequence[GreyArray], to_reference: FloatArray
    ) -> KeyframeMatch | None:
        """The match of the patches, if it fixes the whole frame, not only the part with the patches."""
        match = self._match(keyframe, images, to_reference)
        is_whole = match is not None and match.deviation <= self._limits.ransac_threshold
        return match if is_whole else None

    def _revisit(self, images: Sequence[GreyArray], found: Placement) -> Placement | None:
        """Switches to an earlier keyframe that the camera has returned to, and that fits better."""
        active, least, most_std = self.keyframes.active, _TIED_OVERLAP, math.inf
        if found.match is not None:
            least, most_std = self._settings.keyframe_overlap + _REVISIT_MARGIN, found.match.corner_std
        near = self.keyframes.overlapping(found.to_reference, active.shape, min(least, 0.95))
        candidates = [keyframe for keyframe in near if keyframe.index != active.index]
        for keyframe in candidates[:_REVISIT_TRIES]:
            match = self._match_whole(keyframe, images, found.to_reference)
            if match is not None and match.corner_std < most_std:
                return self._moved_to(keyframe, placed(keyframe, match), found)
        return None

    def _return(self, images: Sequence[GreyArray], found: Placement) -> Placement | None:
        """Leaves a doubtful keyframe for one of the plane whose area matches, or features, now and then.

        What hid the scene may be gone, while frames continue on a keyframe that was taken from a prediction.
        """
        self._doubtful_frames += 1
        periods, phase = divmod(self._doubtful_frames, _RETURN_PERIOD)
        if not periods or phase > 1:
            return None
        plane, small = self.keyframes.plane, images[self._level]
        certain = [one for one in self.keyframes.stored if one.plane == plane and one.corner_std <= OK_STD]
        if not phase:
            for keyframe in certain[: -_REVISIT_TRIES - 1 : -1]:
                to_key = normalised(inverse(keyframe.to_reference) @ found.to_reference)
                place = placed(keyframe, self._dense.match_from(keyframe, small, to_key, found.std))
                if place.std < found.std and place.match is not None and place.match.share >= SURE_SHARE:
                    return self._moved_to(keyframe, place, found)
            return None
        # In the next frame, as each takes as long as two frames.
        features = self._describe(images)
        for keyframe in likeliest(features, certain, _RELOCALISED):
            match = match_by_features(features, keyframe)
            if match is not None:
                place = self._place_recognised(images, keyframe, match, is_jump=False)
                if place.match is not None and place.std < found.std:
                    return self._moved_to(keyframe, replace(place, is_recognised=False), found)
        return None

    def _moved_to(self, keyframe: Keyframe, place: Placement, found: Placement) -> Placement:
        """Makes an earlier keyframe current; the plane moves by as much as it places a frame elsewhere."""
        self.keyframes.activate(keyframe)
        self._unmatched = 0
        return replace(place, change=normalised(place.to_reference @ inverse(found.to_reference)))

    def _promote(self, images: Sequence[GreyArray], found: Placement) -> Placement:
        """Makes the frame a keyframe, tied to the keyframes that it overlaps most."""
        change, active = self.keyframes.adopt(), self.keyframes.active
        if change is not None:
            found = replace(found, to_reference=normalised(change @ found.to_reference))
        matches = {}
        shape = (images[0].shape[0], images[0].shape[1])
        for keyframe in self.keyframes.overlapping(found.to_reference, shape, _TIED_OVERLAP)[:_TIED]:
            match = self._match(keyframe, images, found.to_reference, _TIED_POINTS)
            if match is not None:
                matches[keyframe.index] = keyframe, match
        if found.match is not None and active.index not in matches:
            matches[active.index] = active, found.match
        # A tie to a doubtful keyframe is as doubtful, however precise it is.
        best = min((placed(*tie) for tie in matches.values()), key=lambda place: place.std, default=found)
        if found.match is None or found.std > OK_STD:
            found = replace(best, field_error=found.field_error)
        for _, match in matches.values():
            self.keyframes.learn(match)
        own = math.hypot(best.std, found.field_error)
        ties = [tie_of(keyframe, 0, match.on_plane()) for keyframe, match in matches.values()]
        self.add(images, found.to_reference, ties, own if own > _MAX_FORGOTTEN_STD else 0.0)
        return replace(found, is_keyframe=True, change=change)
