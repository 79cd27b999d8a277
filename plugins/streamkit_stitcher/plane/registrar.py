"""Registration of each frame of a stream to a reference plane."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

from streamkit.geometry.homography import IDENTITY, GreyArray, corner_shift, inverse, normalised
from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_kernels import prepare
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.frame_registration import (
    OK_STD,
    FrameRegistration,
    KeyframeRegistration,
)
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import KeyframeMatch
from streamkit_stitcher.plane.motion_prediction import MotionPredictor
from streamkit_stitcher.plane.photograph_rule import PhotographRule
from streamkit_stitcher.plane.planes import Planes
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import (
    PairwiseMotion,
    WorkingImage,
    register,
    working_image,
    working_level,
)
from streamkit_stitcher.registration.patches import pyramid

_MAX_LOST: Final = 25
# Largest predicted error of the motion since the previous frame, px: two deviations are 2 px.
_OK_STEP_STD: Final = 1.0
# Growth of the predicted error with each lost frame, px.
_LOST_STD: Final = 1.0
_STILL_SHIFT: Final = 0.2
# Share of the contrast that agrees with a dense alignment: certainly, beyond chance, and, where the camera is
# at rest and nothing was searched for, twice that of another scene (at most 0.028 over 132 pairs of scenes).
_AGREEING: Final = 0.2
_RELATED: Final = 0.12
_SAME_SCENE: Final = 0.06
# By how much more must agree under the motion of the corners.
_MORE: Final = 2.0
_ADOPT_AFTER: Final = 10
# Frames without a matching keyframe after which relocalisation is tried at every sixteenth only.
_OFTEN: Final = 4
_RARELY: Final = 16


class FrameRegistrar:
    """Registers the frames of a stream, one after the other, to a plane.

    Each frame is matched with the current keyframe near its predicted homography; where that fails, it is
    registered to the previous frame, then relocalised by features. Keyframes are adjusted together in the
    background; where the camera returns to one of them, it becomes current again, which removes drift. A
    cut, a new frame size, or too many lost frames start a new plane. So does a frame that the plane stretches
    too much, because of drift or an oblique view, but `change` relates that one to the previous plane.

    From one frame to the next, `change @ previous.to_reference @ to_previous` is `to_reference`, with the
    identity where `change` is None. Close it, or its threads stay.

    Args:
        settings: the tracker's settings.
    """

    def __init__(self, settings: PlaneSettings) -> None:
        # Compiles the kernels: else the stream would wait at the first alignment.
        prepare("streamkit_stitcher")
        self._settings = settings
        self._planes = Planes(settings)
        self._previous: FrameRegistration | None = None
        self._std_before = 0.0  # predicted error of the previous frame, px
        self._reset((0, 0))

    def restart(self) -> None:
        """Starts a new plane with the next frame, unrelated to the previous ones."""
        if self._previous is not None:
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
        shape = (int(grey.shape[0]), int(grey.shape[1]))
        if shape != self._shape:
            if self._shape != (0, 0):
                self.restart()
            self._planes.retire()
            self._reset(shape)
        images, anchor = pyramid((grey,), self._level + 1), self._planes.anchor
        if anchor is None or self._last_image is None:
            return self._start_plane(images)
        self._since_key += 1
        if anchor.keyframes.is_adjusting and self._since_key >= _ADOPT_AFTER:
            self._planes.adopt(anchor.keyframes.adopt())
        return self._register(images, anchor, self._last_image)

    def _reset(self, shape: tuple[int, int]) -> None:
        """Drops all state but the keyframes; frames of `shape` follow."""
        self._shape = shape
        self._level = working_level(shape, self._settings.registration_width)
        self._last_image: GreyArray | None = None
        self._motion, self._photographs = MotionPredictor(shape), PhotographRule(shape)
        self._lost = self._unmeasured = self._since_key = 0

    def _working_image(self, images: Sequence[GreyArray], level: int) -> WorkingImage:
        return working_image(images, level, self._settings.max_points)

    def _start_plane(self, images: Sequence[GreyArray]) -> FrameRegistration:
        """Starts a plane with its first usable frame."""
        image = self._working_image(images, self._level)
        if image.is_blank:
            return self._predict()
        self._planes.start(images, self._level)
        self._last_image = image.grey
        status = RegistrationStatus.OK if self._planes.number == 0 else RegistrationStatus.CUT
        return self._publish(
            FrameRegistration(
                IDENTITY,
                IDENTITY,
                self._planes.number,
                status,
                keyframe=True,
                measured=True,
                key_index=self._key_index,
            )
        )

    def _restart_plane(self, images: Sequence[GreyArray]) -> FrameRegistration:
        """Starts another plane with a frame that no keyframe matches."""
        self.restart()
        return self._start_plane(images)

    def _recognise(self, images: Sequence[GreyArray], anchor: KeyframeAnchor) -> KeyframeMatch | None:
        """Matches a frame by features; the plane of the matching keyframe becomes current."""
        recognised = self._planes.recognise(images, anchor)
        if recognised is not None:
            self._photographs.is_video = False
        if self._planes.has_jumped:
            self._motion = MotionPredictor(self._shape)
        return recognised

    def _register(
        self, images: Sequence[GreyArray], anchor: KeyframeAnchor, base: GreyArray
    ) -> FrameRegistration:
        """Registers a frame where the current keyframe expects it, else by the motion since the last."""
        before, std = self._planes.before, self._std_before
        expected = self._motion.expected(before)
        due = 0 < self._settings.keyframe_interval <= self._since_key
        near = None
        if self._motion.predicted == 0:
            near = anchor.matching.near(images, images[self._level], before, std, expected)
        if near is not None and near.share >= _AGREEING:
            self._photographs.is_video = True
            if (active := anchor.keyframes.active) is not None:
                step = normalised(inverse(before) @ active.to_reference @ near.fit.matrix)
                due = due or self._photographs.is_jump(step)
            return self._accept(images, anchor.register(images, expected, True, near, due=due), None)
        image = self._working_image(images, self._level)
        if image.is_blank:
            return self._predict()
        earlier = replace(self._working_image((base,), 0), factor=image.factor)
        guess = normalised(inverse(self._planes.last_to_plane) @ expected)
        limits = self._settings.limits
        reach = min(1.0, limits.max_step * (1 + self._motion.predicted))
        motion = register(earlier, image, guess, replace(limits, max_step=reach))
        is_related = near is not None and near.share >= (_SAME_SCENE if near.at_rest else _RELATED)
        if near is not None and is_related and motion.model is MotionModel.HOMOGRAPHY:
            # Movers may win among the corners: the area decides.
            measured = normalised(self._planes.last_to_plane @ motion.matrix)
            moved = anchor.matching.align(images[self._level], before, std, measured)
            is_related = moved is None or moved.share <= _MORE * near.share
        if is_related:
            return self._accept(images, anchor.register(images, expected, True, near, due=due), None)
        is_photograph = self._photographs.is_photograph(earlier, image, motion)
        return self._register_by_motion(images, anchor, motion, due, is_photograph)

    def _register_by_motion(
        self,
        images: Sequence[GreyArray],
        anchor: KeyframeAnchor,
        motion: PairwiseMotion,
        due: bool,
        is_photograph: bool,
    ) -> FrameRegistration:
        """Registers a frame from where the motion since the last one puts it, or relocalises it."""
        consecutive, known = self._motion.predicted == 0, motion.model is not None
        expected = self._motion.expected(self._planes.before)
        recognised = None
        if motion.is_cut:
            recognised = self._recognise(images, anchor)
            if recognised is None and consecutive:
                return self._restart_plane(images)
        # Photographs are all keyframes: the more of them are tied, the straighter is the survey.
        due = due or is_photograph
        predicted = normalised(self._planes.last_to_plane @ motion.matrix) if known else expected
        std = (motion.corner_std(self._shape) if known else _LOST_STD) + self._std_before
        trusted = motion.model is MotionModel.HOMOGRAPHY
        is_jump = consecutive or self._planes.has_jumped
        place = partial(anchor.register, images, predicted, consecutive=is_jump, predicted_std=std)
        keyframe_fit = place(
            trusted or recognised is not None,
            recognised=recognised,
            due=due and (trusted or recognised is not None),
        )
        is_open = not (keyframe_fit.measured or keyframe_fit.keyframe or recognised is not None)
        # Where the motion is known but keyframes never match, as over relief, the tries become rarer.
        pause = _RARELY if known and consecutive and self._unmeasured > _OFTEN else 2
        if is_open and self._unmeasured % pause == 0:
            recognised = self._recognise(images, anchor)
            if recognised is not None:
                keyframe_fit = place(trusted=True, recognised=recognised, due=due)
        if not (known or recognised is not None or keyframe_fit.measured):
            self._lost += 1
            self._unmeasured += 1
            # Without a frame that was followed these are photographs: each may begin a plane of its own.
            if motion.is_cut or self._lost > _MAX_LOST or is_photograph:
                return self._restart_plane(images)
            return self._predict()
        return self._accept(images, keyframe_fit, motion)

    @property
    def _key_index(self) -> int:
        active = None if self._planes.anchor is None else self._planes.anchor.keyframes.active
        return 0 if active is None else active.index

    def _accept(
        self, images: Sequence[GreyArray], keyframe_fit: KeyframeRegistration, motion: PairwiseMotion | None
    ) -> FrameRegistration:
        """Publishes a registered frame, at the previous homography where nothing moved."""
        self._planes.adopt(keyframe_fit.reference_change)
        to_reference = keyframe_fit.to_reference
        if keyframe_fit.keyframe and self._planes.anchor is not None:
            self._since_key = 0
            to_reference = self._planes.add_keyframe(self._planes.anchor, images, to_reference, self._level)
        previous, before = self._previous, self._planes.before
        self._last_image, self._planes.last_to_plane = images[self._level], to_reference
        to_previous = normalised(inverse(before) @ to_reference)
        steady = previous is not None and previous.status is not RegistrationStatus.LOST
        std = keyframe_fit.corner_std
        # The measurement fixes the whole frame, and the motion since a previous frame that was seen.
        is_certain = (
            keyframe_fit.measured
            and keyframe_fit.fixes_whole_frame
            and std <= OK_STD
            and not (steady and math.hypot(self._std_before, std) > _OK_STEP_STD)
        )
        status = RegistrationStatus.OK if is_certain else RegistrationStatus.WEAK
        if (
            status is RegistrationStatus.OK
            and steady
            and corner_shift(to_previous, self._shape) < _STILL_SHIFT
        ):
            # Compared with the measured homography, never accumulated: slow drift is released after 0.2 px.
            to_previous, to_reference, status = IDENTITY, before, RegistrationStatus.STILL
        if self._planes.has_jumped:
            to_previous, status = IDENTITY, RegistrationStatus.CUT
            self._planes.reference_change = self._planes.rebase = None
        self._motion.update(to_previous)
        self._lost = 0
        self._unmeasured = 0 if keyframe_fit.measured else self._unmeasured + 1
        counted: KeyframeRegistration | PairwiseMotion = (
            keyframe_fit if keyframe_fit.measured or motion is None else motion
        )
        active = None if self._planes.anchor is None else self._planes.anchor.keyframes.active
        to_key = IDENTITY if active is None else normalised(inverse(active.to_reference) @ to_reference)
        return self._publish(
            FrameRegistration(
                to_previous,
                to_reference,
                self._planes.number,
                status,
                keyframe=keyframe_fit.keyframe,
                matches=counted.matches,
                inliers=counted.inliers,
                rmse=counted.rmse,
                corner_std=keyframe_fit.corner_std,
                measured=keyframe_fit.measured,
                key_index=self._key_index,
                to_key=to_key,
            )
        )

    def _predict(self) -> FrameRegistration:
        """Publishes a lost frame at its predicted homography."""
        expected = self._motion.expected(self._planes.before)
        self._motion.predicted += 1
        to_previous = normalised(inverse(self._planes.before) @ expected)
        std = self._std_before + corner_shift(to_previous, self._shape) + _LOST_STD
        return self._publish(
            FrameRegistration(
                to_previous, expected, self._planes.number, RegistrationStatus.LOST, corner_std=std
            )
        )

    def _publish(self, registered: FrameRegistration) -> FrameRegistration:
        planes = self._planes
        if planes.reference_change is not None:
            registered = replace(
                registered,
                reference_change=planes.reference_change,
                rebase=planes.rebase,
                opens_plane=planes.has_opened,
            )
        self._previous, planes.before = registered, registered.to_reference
        self._std_before = registered.corner_std
        return registered
