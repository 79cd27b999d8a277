"""Registration of each frame of a stream to a reference plane."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    GreyArray,
    corner_shift,
    inverse,
    normalised,
)
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.plane.anchoring import SURE_SHARE, KeyframeAnchor
from streamkit_stitcher.plane.footage import Footage, is_jump
from streamkit_stitcher.plane.frame_registration import OK_STD, FrameRegistration
from streamkit_stitcher.plane.keyframe_content import LEVELS, scene_level
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import KeyframeMatch
from streamkit_stitcher.plane.localisation import Localisation
from streamkit_stitcher.plane.placement import Placement, placed
from streamkit_stitcher.plane.planes import Planes
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.combing import field_error
from streamkit_stitcher.registration.dense_alignment import MIN_AGREEMENT
from streamkit_stitcher.registration.pairwise import (
    PairwiseMotion,
    WorkingImage,
    register,
    working_level,
)
from streamkit_stitcher.registration.patches import pyramid

_STILL_SHIFT: Final = 0.2
_ADOPT_AFTER: Final = 10
# Predicted error of a frame that starts a plane as nothing else was known, px: leaves that fill it and the
# next one move along by 2 to 5 px.
_UNSURE_STD: Final = 2.0


class FrameRegistrar:
    """Registers the frames of a stream, one after the other, to a plane.

    The first method that succeeds registers a frame:

    1. Patches of the current keyframe near the predicted place; 2. all of its area: `ok` or `still`, `weak`
       where the predicted error is large. Left out after a lost frame.
    3. Corners of the last frame, then patches of the current keyframe near where these lead: as above, `weak`
       where no patches match.
    4. Features of the stored keyframes, at a cut, for photographs, and at some of the frames that no keyframe
       matches.
    5. The predicted motion: `lost`. Not at a cut, not for photographs, and for 25 frames at most.
    6. A new plane that begins with the frame: `cut`. Also where frames continue each other, but may be off by
       more than a tenth of the width.

    Keyframes are adjusted together in the background; where the camera returns to one of them, it becomes
    current again, which removes drift. A new frame size starts a new plane, too. So does a frame that the
    plane stretches too much, because of drift or an oblique view, but `change` relates that one to the
    previous plane.

    From one frame to the next, `change @ previous.to_reference @ to_previous` is `to_reference`, with the
    identity where `change` is None. Close it, or its threads stay.

    Args:
        settings: of the registration.
    """

    def __init__(self, settings: PlaneSettings) -> None:
        self._settings = settings
        self._planes = Planes(settings)
        self._footage = Footage()
        self._reset((0, 0))

    def _reset(self, shape: tuple[int, int]) -> None:
        """Drops all state but the keyframes; frames of `shape` follow."""
        self._shape = shape
        self._level = working_level(shape, self._settings.registration_width)
        self._levels = 1 + max(LEVELS - 1, self._level, scene_level(shape, is_video=True))
        self._last: WorkingImage | None = None
        self._place = Localisation(shape)
        self._footage.restart()
        self._since_key = 0

    def restart(self) -> None:
        """Starts a new plane with the next frame, unrelated to the previous ones."""
        if self._shape != (0, 0):
            self._planes.leave()
        self._reset(self._shape)

    def keep_planes(self, keeps: bool) -> None:
        """Sets whether a plane that ends stays, to be met again; else it ends for good."""
        self._planes.keeps_earlier = keeps

    @property
    def ended_planes(self) -> int:
        """Number of planes that ended for good, joined ones counted once."""
        return self._planes.ended

    def close(self) -> None:
        """Ends the threads."""
        self._planes.close()

    def take_plane(self, current: bool = False) -> KeyframeMap | None:
        """The keyframes of the planes that ended for good, or of all with `current`; close them."""
        if current:
            self.restart()
            self._planes.retire()
        return self._planes.take_closed()

    def skip(self) -> FrameRegistration:
        """Registers a corrupt frame by prediction only; status lost."""
        self._planes.begin_frame()
        return self._predict()

    def register(self, grey: GreyArray) -> FrameRegistration:
        """Registers the next frame; every matrix is finite.

        Frames no wider than the registration width are kept without a copy, and must not change.
        """
        self._planes.begin_frame()
        shape = int(grey.shape[0]), int(grey.shape[1])
        if shape != self._shape:
            self._begin_shape(shape)
        images = pyramid((grey,), self._levels)
        image = WorkingImage(images[self._level], 2**self._level, self._settings.max_points)
        found = self._register(images, image)
        self._footage.add(image, found.to_previous)
        return found

    def _register(self, images: Sequence[GreyArray], image: WorkingImage) -> FrameRegistration:
        last, anchor = self._last, self._planes.anchor
        if anchor is None or last is None:
            return self._start_plane(images, image)
        self._since_key += 1
        if self._since_key == _ADOPT_AFTER:
            change = anchor.keyframes.adopt()
            if change is not None:
                self._planes.adopt(anchor, change)
        before, near = self._planes.before, None
        # After a lost frame the place is not known well enough.
        if not self._place.predicted:
            near = anchor.match_near(images, before, self._place.std, self._place.expected(before))
        if near is not None and self._is_enough(near):
            found = placed(anchor.keyframes.active, near)
            has_jumped = is_jump(normalised(inverse(before) @ found.to_reference), self._shape)
            if self._footage.continues(has_jumped):
                self._place.is_adrift = False
                return self._accept(images, image, anchor, replace(found, is_due=has_jumped))
        if image.is_blank:
            return self._predict()
        return self._search(images, image, last, anchor, near)

    def _is_enough(self, near: KeyframeMatch) -> bool:
        """Whether a match is taken without a search: a sure one, or one that searches have only confirmed."""
        is_weak = near.share >= MIN_AGREEMENT and self._footage.is_video
        return near.share >= SURE_SHARE or (is_weak and not self._place.is_corner_search_due())

    def _search(
        self,
        images: Sequence[GreyArray],
        image: WorkingImage,
        last: WorkingImage,
        anchor: KeyframeAnchor,
        near: KeyframeMatch | None,
    ) -> FrameRegistration:
        """Registers a frame that the current keyframe does not match where it is expected."""
        place, motion = self._place, self._motion_since(last, image)
        predicted = place.predicted_by(motion, self._planes.before, self._planes.last_to_plane)
        is_photograph = self._is_photograph(last, image, motion)
        found = anchor.place(images, near, predicted, place.std, is_photograph)
        place.searched(is_vain=near is not None and found.match is near)
        # Frames that continue each other at an unknown place: a cut was not noticed.
        is_elsewhere = place.stays_adrift(found, motion) and predicted.is_trusted and self._footage.is_calm
        if is_elsewhere or (found.match is None and (is_photograph or place.is_search_due(motion))):
            recognised = self._recognise(images, anchor)
            if recognised is not None and recognised.is_elsewhere:
                is_elsewhere |= self._footage.is_calm
            else:
                found = recognised or found
        is_placed = (found.match is not None or motion.model is not None) and not is_elsewhere
        if is_placed or found.is_recognised:
            # Photographs are all keyframes: the more of them are tied, the straighter is the survey.
            is_due = is_photograph or found.is_due
            found = replace(found, motion=motion, is_due=is_due, is_adrift=place.is_adrift)
            return self._accept(images, image, anchor, found)
        is_cut = motion.is_cut and self._footage.is_abrupt(image)
        if place.lose() or is_cut or is_photograph or is_elsewhere:
            self.restart()
            return self._start_plane(images, image, 0.0 if is_cut or is_photograph else _UNSURE_STD)
        return self._predict()

    def _begin_shape(self, shape: tuple[int, int]) -> None:
        """Ends all planes, as frames have another size from now on."""
        self.restart()
        self._planes.retire()
        self._reset(shape)

    def _start_plane(
        self, images: Sequence[GreyArray], image: WorkingImage, std: float = 0.0
    ) -> FrameRegistration:
        """Starts a plane with its first usable frame, which is known to show the scene to `std` px."""
        if image.is_blank:
            return self._predict()
        self._planes.start(images, self._level)
        self._last, self._place = image, Localisation(self._shape, std)
        status = RegistrationStatus.OK if self._planes.number == 0 else RegistrationStatus.CUT
        return self._publish(IDENTITY, IDENTITY, status, Placement(IDENTITY, 0.0, is_keyframe=True), True)

    def _motion_since(self, last: WorkingImage, image: WorkingImage) -> PairwiseMotion:
        """The motion of the corners since the last frame that was not lost."""
        expected = self._place.expected(self._planes.before)
        guess = normalised(inverse(self._planes.last_to_plane) @ expected)
        limits = self._settings.limits
        reach = min(1.0, limits.max_step * (1 + self._place.predicted))
        return register(last, image, guess, replace(limits, max_step=reach))

    def _is_photograph(self, last: WorkingImage, image: WorkingImage, motion: PairwiseMotion) -> bool:
        """Whether a frame that no keyframe matches is one."""
        continues = motion.model is not None and not is_jump(motion.matrix, self._shape)
        return not continues and self._footage.is_photograph(last, image)

    def _recognise(self, images: Sequence[GreyArray], anchor: KeyframeAnchor) -> Placement | None:
        """Places a frame by features; the plane of the matching keyframe becomes current.

        A frame that lies far from the one before it, whose place was known, is a photograph.
        """
        is_previous_known, anchor.is_video = self._place.is_known, self._footage.is_video
        found = anchor.recognise(images, is_previous_known)
        if found is None or found.is_elsewhere:
            return found
        if anchor.keyframes.plane != self._planes.number:
            self._planes.leave(anchor.keyframes.plane)
            self._place.leave_plane()
        step = normalised(inverse(self._planes.before) @ found.to_reference)
        is_photograph = is_previous_known and not self._planes.has_jumped and is_jump(step, self._shape)
        self._footage.recognised(is_photograph)
        return replace(found, is_due=is_photograph)

    def _accept(
        self, images: Sequence[GreyArray], image: WorkingImage, anchor: KeyframeAnchor, found: Placement
    ) -> FrameRegistration:
        """Publishes a placed frame, and makes it a keyframe where that is due."""
        is_over = 0 < self._settings.keyframe_interval <= self._since_key
        step = normalised(inverse(self._planes.before) @ found.to_reference)
        fields, anchor.is_video = field_error(images[0], step), self._footage.is_video
        found = anchor.keep(images, replace(found, is_due=found.is_due or is_over, field_error=fields))
        if found.change is not None:
            self._planes.adopt(anchor, found.change)
        to_reference, is_measured = found.to_reference, found.match is not None
        if found.is_keyframe:
            self._since_key = 0
            to_reference = self._planes.add_keyframe(anchor, images, to_reference, self._level)
        self._last, self._planes.last_to_plane = image, to_reference
        before = self._planes.before
        to_previous = normalised(inverse(before) @ to_reference)
        found = replace(found, std=math.hypot(found.std, fields))
        status = self._status(to_previous, found)
        if status is RegistrationStatus.STILL:
            # Compared with the measured homography, never accumulated: slow drift is released after 0.2 px.
            to_previous, to_reference = IDENTITY, before
        if status is RegistrationStatus.CUT:
            to_previous = IDENTITY
            self._planes.change = self._planes.rebase = None
        self._place.place(to_previous, found.std, is_measured)
        return self._publish(to_previous, to_reference, status, found, is_measured)

    def _status(self, to_previous: FloatArray, found: Placement) -> RegistrationStatus:
        """How reliable a placed frame is."""
        if self._planes.has_jumped:
            return RegistrationStatus.CUT
        steady = not self._place.predicted
        # Errors of successive frames are alike: the motion between the two is as certain as either.
        is_step_certain = not steady or self._place.std <= OK_STD
        if found.match is None or found.std > OK_STD or not is_step_certain:
            return RegistrationStatus.WEAK
        is_still = steady and corner_shift(to_previous, self._shape) < _STILL_SHIFT
        return RegistrationStatus.STILL if is_still else RegistrationStatus.OK

    def _predict(self) -> FrameRegistration:
        """Publishes a lost frame at its predicted homography."""
        found = self._place.lost_place(self._planes.before)
        to_previous = normalised(inverse(self._planes.before) @ found.to_reference)
        return self._publish(to_previous, found.to_reference, RegistrationStatus.LOST, found)

    def _publish(
        self,
        to_previous: FloatArray,
        to_reference: FloatArray,
        status: RegistrationStatus,
        found: Placement,
        is_measured: bool = False,
    ) -> FrameRegistration:
        planes = self._planes
        matches, inliers, rmse = found.counts
        active = None if planes.anchor is None else planes.anchor.keyframes.active
        planes.before = to_reference
        return FrameRegistration(
            to_previous,
            to_reference,
            planes.number,
            status,
            reference_change=planes.change,
            keyframe=found.is_keyframe,
            matches=matches,
            inliers=inliers,
            rmse=rmse,
            corner_std=found.std,
            measured=is_measured,
            key_index=0 if active is None else active.index,
            to_key=IDENTITY if active is None else normalised(inverse(active.to_reference) @ to_reference),
            rebase=planes.rebase,
            opens_plane=planes.has_opened,
        )
