"""Registration of frames to keyframes, and the choice of new keyframes."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from streamkit.geometry.homography import (
    FloatArray,
    GreyArray,
    inverse,
    normalised,
)
from streamkit_stitcher.plane.frame_registration import OK_STD, KeyframeRegistration
from streamkit_stitcher.plane.keyframe_content import LEVELS, scene_level
from streamkit_stitcher.plane.keyframe_graph import Tie
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch, is_leaving
from streamkit_stitcher.plane.loop_closure import better, tie_of
from streamkit_stitcher.plane.matching import KeyframeMatching
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.descriptors import FrameFeatures, describe
from streamkit_stitcher.registration.motion_models import FitLimits
from streamkit_stitcher.registration.patches import pyramid

# A new keyframe is tied to the keyframes that it overlaps most, this many, by at least this part.
_TIED: Final = 4
_TIED_OVERLAP: Final = 0.25
_TIED_POINTS: Final = 250
# An earlier keyframe takes over where it overlaps this much more than a new one would be needed for.
_REVISIT_MARGIN: Final = 0.1
_REVISIT_TRIES: Final = 2
_RELOCALISED: Final = 3
# Frames without a match after which one becomes a keyframe: where the camera leaves the keyframe, and else.
_MAX_UNMATCHED: Final = 3
_MAX_DOUBTFUL: Final = 12


class KeyframeAnchor:
    """Registers frames to the reference plane through keyframes.

    Args:
        settings: the tracker's settings.
        level: how often frames are halved to working size; sets the search range.
        plane: number of the first plane.

    Attributes:
        keyframes: the keyframes of all planes.
        matching: matches frames with keyframes.
        description: features of the last frame, where it was relocalised.
    """

    def __init__(self, settings: PlaneSettings, level: int, plane: int = 0) -> None:
        self._settings = settings
        threshold = settings.limits.ransac_threshold * 2**level
        self._limits: FitLimits = replace(settings.limits, ransac_threshold=threshold, max_step=1.0)
        self._level = level
        self._search_level = max(0, level - 1)
        self.keyframes = KeyframeMap(settings, plane)
        self.matching = KeyframeMatching(self.keyframes, self._limits, settings.max_points)
        self._relocaliser = self.keyframes.relocaliser
        self.description: FrameFeatures | None = None
        self._unmatched = 0
        self._is_prediction_reliable = True

    def add(
        self,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        ties: Sequence[Tie] = (),
        corner_std: float = 0.0,
    ) -> Keyframe:
        """Makes a frame the current keyframe; the ties to earlier keyframes may name any observer."""
        keyframe = self.keyframes.add(images, to_reference, self._level, ties, corner_std)
        self.matching.prepare(keyframe)
        if self.description is not None:
            self._relocaliser.remember(keyframe, self.description)
        self._unmatched = 0
        self._is_prediction_reliable = True
        return keyframe

    def recognise(self, images: Sequence[GreyArray]) -> KeyframeMatch | None:
        """Matches a frame of unknown motion by features: the newest keyframes, then the likeliest of all.

        The matching keyframe becomes current, and its plane, too.
        """
        newest = list(self.keyframes.stored[::-1])
        if not newest:
            return None
        level = scene_level(images[0].shape)
        description = self.description = describe(pyramid(images, level + 1)[level])
        active = self.keyframes.active
        if active is not None:
            newest = [active, *(keyframe for keyframe in newest if keyframe.index != active.index)]
        recent, older = newest[:_RELOCALISED], newest[_RELOCALISED:]
        return self._recognised(description, recent) or self._recognised(
            description, self._relocaliser.likeliest(description, older, _RELOCALISED)
        )

    def _recognised(self, description: FrameFeatures, candidates: Sequence[Keyframe]) -> KeyframeMatch | None:
        """The first match, of the keyframe that becomes current."""
        for keyframe in candidates:
            match = self._relocaliser.match(description, keyframe)
            if match is not None:
                self.keyframes.active = keyframe
                return match
        return None

    def register(
        self,
        images: Sequence[GreyArray],
        predicted: FloatArray,
        trusted: bool,
        followed: KeyframeMatch | None = None,
        recognised: KeyframeMatch | None = None,
        due: bool = False,
        consecutive: bool = False,
        predicted_std: float = 0.0,
    ) -> KeyframeRegistration:
        """Registers a frame, and makes it a keyframe where one is needed.

        Args:
            images: the frame.
            predicted: its homography by the motion since the previous frame.
            trusted: whether that motion is a measured homography; otherwise the search is wider and the
                prediction is not good enough for a keyframe.
            followed: the result of `matching.near`, which saves the search.
            recognised: the result of `recognise`, from where the search begins.
            due: whether the frame becomes a keyframe in any case.
            consecutive: whether a recognised frame directly follows the previous one, as photographs do; it
                is then registered by its small overlap, and not certain.
            predicted_std: error of `predicted` at the frame's worst corner, px.
        """
        if recognised is None:
            self.description = None
        active = self.keyframes.active
        if active is None:
            return KeyframeRegistration(predicted, measured=False, corner_std=predicted_std)
        match = followed
        if recognised is not None:
            predicted = normalised(active.to_reference @ recognised.fit.matrix)
            match, predicted = self._aligned(active, images, predicted, recognised, consecutive)
        elif match is None:
            match = self._search(active, images, predicted, trusted)
        certain = recognised is None or self.matching.if_whole_frame(match) is not None
        found = KeyframeRegistration(predicted, measured=False, corner_std=predicted_std)
        if match is not None:
            found = _registration_by(active, match)
        found = replace(found, fixes_whole_frame=certain)
        self._unmatched = 0 if match is not None else self._unmatched + 1
        self._is_prediction_reliable = match is not None or (
            trusted and recognised is None and self._is_prediction_reliable
        )
        leaving = is_leaving(active, found.to_reference, self._settings.keyframe_overlap)
        if match is not None and not due and not leaving:
            return found
        revisited = None if due or recognised is not None else self._revisit(active, images, found)
        if revisited is not None:
            return revisited
        # An unmatched frame that should overlap its keyframe is probably at fault itself; after an unreliable
        # prediction, a later frame may match the keyframe.
        patience = _MAX_UNMATCHED if leaving and self._is_prediction_reliable else _MAX_DOUBTFUL
        if match is None and (not trusted or self._unmatched < patience):
            return found
        return self._promote(images, found, None if match is None else (active, match))

    def _search(
        self, active: Keyframe, images: Sequence[GreyArray], predicted: FloatArray, trusted: bool
    ) -> KeyframeMatch | None:
        """Matches with the current keyframe from fast to thorough."""
        level = self._search_level if trusted else LEVELS - 1
        match = self.matching.if_whole_frame(self.matching.follow(active, images, predicted))
        match = match or self.matching.if_whole_frame(self.matching.search(active, images, predicted, level))
        if match is None and trusted:
            match = self.matching.if_whole_frame(self.matching.search(active, images, predicted, LEVELS - 1))
        return match

    def _aligned(
        self,
        active: Keyframe,
        images: Sequence[GreyArray],
        predicted: FloatArray,
        recognised: KeyframeMatch,
        consecutive: bool,
    ) -> tuple[KeyframeMatch | None, FloatArray]:
        """A match that fixes the whole of a recognised frame, and the likeliest homography.

        Returns the match, None where there is none and the frame is not consecutive, and the homography.
        """
        aligned = self.matching.if_whole_frame(self.matching.follow(active, images, predicted))
        aligned = aligned or self.matching.search(active, images, predicted, LEVELS - 1)
        best = better(recognised, aligned, active, self._settings.max_points)
        found = (
            self.matching.if_whole_frame(best)
            or self.matching.if_whole_frame(aligned)
            or (best if consecutive else None)
        )
        if found is None and aligned is not None and aligned.deviation < recognised.deviation:
            predicted = normalised(active.to_reference @ aligned.fit.matrix)
        return found, predicted

    def _revisit(
        self, active: Keyframe, images: Sequence[GreyArray], found: KeyframeRegistration
    ) -> KeyframeRegistration | None:
        """Switches to an earlier keyframe where the camera has returned to it."""
        least = self._settings.keyframe_overlap + _REVISIT_MARGIN if found.measured else _TIED_OVERLAP
        near = self.keyframes.overlapping(found.to_reference, active.shape, min(least, 0.95))
        candidates = [keyframe for _, keyframe in near if keyframe.index != active.index]
        for keyframe in candidates[:_REVISIT_TRIES]:
            match = self.matching.if_whole_frame(
                self.matching.follow(keyframe, images, found.to_reference)
                or self.matching.search(keyframe, images, found.to_reference, LEVELS - 1)
            )
            if match is not None:
                self.keyframes.active = keyframe
                self._unmatched = 0
                revisited = _registration_by(keyframe, match)
                change = normalised(revisited.to_reference @ inverse(found.to_reference))
                return replace(revisited, reference_change=change)
        return None

    def _promote(
        self,
        images: Sequence[GreyArray],
        found: KeyframeRegistration,
        known: tuple[Keyframe, KeyframeMatch] | None,
    ) -> KeyframeRegistration:
        """Makes the frame a keyframe, tied to the keyframes that it overlaps.

        `found` is its registration so far, `known` the keyframe it was measured against, and the match.
        """
        change = self.keyframes.adopt() if self.keyframes.is_adjusting else None
        if change is not None:
            found = replace(found, to_reference=normalised(change @ found.to_reference))
        shape = (images[0].shape[0], images[0].shape[1])
        matches = self._overlapping_matches(images, found.to_reference, shape, known)
        if known is None and matches:
            found = replace(_registration_by(*matches[0]), fixes_whole_frame=found.fixes_whole_frame)
        elif known is not None and known[0].index not in {keyframe.index for keyframe, _ in matches}:
            matches.append((self.keyframes.current(known[0]), known[1].most_precise()))
            self.keyframes.learn(known[1])
        # Of its own registration only: ties and adjustments correct what earlier keyframes had.
        own = min((match.corner_std for _, match in matches), default=found.corner_std)
        ties = [tie_of(keyframe, 0, match) for keyframe, match in matches]
        self.add(images, found.to_reference, ties, own if own > OK_STD else 0.0)
        return replace(found, keyframe=True, reference_change=change)

    def _overlapping_matches(
        self,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        shape: tuple[int, int],
        known: tuple[Keyframe, KeyframeMatch] | None,
    ) -> list[tuple[Keyframe, KeyframeMatch]]:
        """The frame's matches with the keyframes that it overlaps most."""
        matches = []
        for _, keyframe in self.keyframes.overlapping(to_reference, shape, _TIED_OVERLAP)[:_TIED]:
            if known is not None and known[0].index == keyframe.index and known[1].variances is not None:
                match: KeyframeMatch | None = known[1]
            else:
                match = self.matching.follow(
                    keyframe, images, to_reference, _TIED_POINTS
                ) or self.matching.search(keyframe, images, to_reference, self._search_level, _TIED_POINTS)
            if match is not None:
                matches.append((keyframe, match.most_precise()))
                self.keyframes.learn(match)
        return matches


def _registration_by(keyframe: Keyframe, match: KeyframeMatch) -> KeyframeRegistration:
    return KeyframeRegistration(
        normalised(keyframe.to_reference @ match.fit.matrix),
        measured=True,
        matches=len(match.fit.inliers),
        inliers=match.fit.count,
        rmse=match.fit.rmse,
        corner_std=math.hypot(match.corner_std, keyframe.corner_std),
    )
