"""Registration of each frame of a stream to a reference plane."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    GreyArray,
    corner_shift,
    inverse,
    normalised,
    scale_change,
)
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.correlation_shift import search_shift
from streamkit_stitcher.plane.frame_registration import AnchoredFrame, FrameRegistration, Status, depth_ratio
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.motion_prediction import MotionPredictor
from streamkit_stitcher.plane.schedule import ReferenceSchedule
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.corners import CornerDetector
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import (
    PairwiseMotion,
    WorkingImage,
    is_flat,
    register,
    working_image,
    working_level,
)
from streamkit_stitcher.registration.patches import pyramid
from streamkit_stitcher.warm_up import warm_up

_MAX_LOST: Final = 25
_STILL_SHIFT: Final = 0.2
_ADOPT_AFTER: Final = 10
_RECOGNISE_EVERY: Final = 2
_RECOGNISE_OFTEN: Final = 4
_RECOGNISE_RARELY: Final = 16
# Well within the limits of a mosaic, see `mosaic.is_paintable`.
_PLANE_SCALE: Final = (0.3, 3.3)
_MAX_DEPTH_RATIO: Final = 1.5


class PlaneTracker:
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
        # Here, as the stream would wait for the compiler at the first alignment.
        warm_up()
        self._settings = settings
        self._reference = 0
        self._previous: FrameRegistration | None = None
        self._begin_frame()
        self._closed: KeyframeMap | None = None
        self._anchor: KeyframeAnchor | None = None
        self._reset((0, 0))

    def restart(self) -> None:
        """Starts a new plane with the next frame, unrelated to the previous ones."""
        if self._previous is not None:
            self._reference += 1
            self._previous = replace(
                self._previous, to_reference=IDENTITY, reference=self._reference, anchored=False
            )
        self._reset((0, 0))

    def close(self) -> None:
        """Ends the threads."""
        for keyframes in (None if self._anchor is None else self._anchor.keyframes, self._closed):
            if keyframes is not None:
                keyframes.close()

    def take_plane(self, current: bool = False) -> KeyframeMap | None:
        """The keyframes of the last finished or of the current plane, which then ends; close them."""
        if current:
            self.restart()
        closed, self._closed = self._closed, None
        return closed

    def skip(self) -> FrameRegistration:
        """Registers a corrupt frame by prediction only; status lost."""
        self._begin_frame()
        return self._predict()

    def track(self, grey: GreyArray) -> FrameRegistration:
        """Registers the next frame; every matrix is finite.

        Frames no wider than the registration width are kept without a copy, and must not change.
        """
        self._begin_frame()
        shape = (int(grey.shape[0]), int(grey.shape[1]))
        if shape != self._shape:
            if self._shape != (0, 0):
                self.restart()
            self._reset(shape)
        images = pyramid((grey,), self._level + 1)
        if self._anchor is None or self._base is None:
            return self._start_plane(images)
        self._since_key += 1
        if self._anchor.keyframes.is_adjusting and self._since_key >= _ADOPT_AFTER:
            self._move_plane(self._anchor.keyframes.adopt())
        return self._register(images, self._anchor, self._base)

    def _begin_frame(self) -> None:
        self._change: FloatArray | None = None
        self._rebase: FloatArray | None = None
        self._opens_plane = False

    def _reset(self, shape: tuple[int, int]) -> None:
        """Drops all state; frames of `shape` follow."""
        self._shape = shape
        self._level = working_level(shape, self._settings.registration_width)
        self._detector = CornerDetector()
        self._schedule = ReferenceSchedule(self._settings.strip_length)
        self._retire()
        self._base: GreyArray | None = None
        self._base_to_reference = IDENTITY
        self._motion = MotionPredictor(shape)
        self._lost = self._unmeasured = self._since_key = 0

    @property
    def _before(self) -> FloatArray:
        """float64[3, 3], the previous frame to the reference plane."""
        return IDENTITY if self._previous is None else self._previous.to_reference

    def _working_image(self, images: Sequence[GreyArray], level: int) -> WorkingImage:
        return working_image(images, level, self._detector, self._settings.max_points)

    def _start_plane(self, images: Sequence[GreyArray]) -> FrameRegistration:
        """Starts a plane with its first usable frame."""
        image = self._working_image(images, self._level)
        if image.is_blank:
            return self._predict()
        self._anchor = KeyframeAnchor(self._settings, self._level)
        self._anchor.add(images, IDENTITY)
        self._base, self._base_to_reference = image.grey, IDENTITY
        status = Status.OK if self._reference == 0 else Status.CUT
        return self._publish(
            FrameRegistration(IDENTITY, IDENTITY, self._reference, status, keyframe=True, anchored=True)
        )

    def _restart_plane(self, images: Sequence[GreyArray]) -> FrameRegistration:
        shape = self._shape
        self.restart()
        self._reset(shape)
        return self._start_plane(images)

    def _register(
        self, images: Sequence[GreyArray], anchor: KeyframeAnchor, base: GreyArray
    ) -> FrameRegistration:
        expected = self._motion.expected(self._before)
        due = 0 < self._settings.keyframe_interval <= self._since_key
        followed = anchor.follow(images, expected) if self._motion.predicted == 0 else None
        if followed is not None:
            anchored = anchor.register(images, expected, trusted=True, followed=followed, due=due)
            return self._accept(images, anchored, None)
        if is_flat(images[self._level]):
            return self._predict()
        image = self._working_image(images, self._level)
        if image.is_blank:
            return self._predict()
        motion = self._pairwise_motion(base, image, expected)
        known = motion.model is not None
        consecutive = self._motion.predicted == 0
        recognised = None
        if motion.is_cut:
            recognised = anchor.recognise(image.grey)
            if recognised is None and consecutive:
                return self._restart_plane(images)
        predicted = normalised(self._base_to_reference @ motion.matrix) if known else expected
        trusted = motion.model is MotionModel.HOMOGRAPHY
        anchored = anchor.register(
            images,
            predicted,
            trusted or recognised is not None,
            recognised=recognised,
            due=due and trusted,
            consecutive=consecutive,
        )
        if not anchored.measured and recognised is None and self._is_recognition_due(known):
            recognised = anchor.recognise(image.grey)
            if recognised is not None:
                anchored = anchor.register(
                    images, predicted, trusted=True, recognised=recognised, due=due, consecutive=consecutive
                )
        if not (known or recognised is not None or anchored.measured):
            self._lost += 1
            self._unmeasured += 1
            if motion.is_cut or self._lost > _MAX_LOST:
                return self._restart_plane(images)
            return self._predict()
        return self._accept(images, anchored, motion)

    def _pairwise_motion(self, base: GreyArray, image: WorkingImage, expected: FloatArray) -> PairwiseMotion:
        """The motion since the last registered frame, searched by cross-correlation after a large shift."""
        limits = self._settings.limits
        reach = replace(limits, max_step=min(1.0, limits.max_step * (1 + self._motion.predicted)))
        guess = normalised(inverse(self._base_to_reference) @ expected)
        earlier = replace(self._working_image((base,), 0), factor=image.factor)
        motion = register(earlier, image, guess, reach)
        if motion.model is not None:
            return motion
        shift = search_shift(earlier.grey, image.grey, image.factor)
        if shift is None:
            return motion
        shifted = register(earlier, image, shift, replace(limits, max_step=1.0))
        return shifted if shifted.model is MotionModel.HOMOGRAPHY else motion

    def _is_recognition_due(self, known: bool) -> bool:
        """Whether to relocalise an unmeasured frame.

        Where the motion is known but keyframes never match, as over relief, the tries become rarer.
        """
        count = self._unmeasured
        if known and not self._motion.predicted and count > _RECOGNISE_OFTEN:
            return count & (count - 1) == 0 or count % _RECOGNISE_RARELY == 0
        return count % _RECOGNISE_EVERY == 0

    def _accept(
        self, images: Sequence[GreyArray], anchored: AnchoredFrame, motion: PairwiseMotion | None
    ) -> FrameRegistration:
        """Publishes a registered frame, at the previous homography where nothing moved."""
        self._move_plane(anchored.change)
        to_reference = anchored.to_reference
        if anchored.keyframe:
            to_reference = self._add_keyframe(images, to_reference)
        previous, before = self._previous, self._before
        self._base, self._base_to_reference = images[self._level], to_reference
        to_previous = normalised(inverse(before) @ to_reference)
        status = Status.OK if anchored.measured and anchored.certain else Status.WEAK
        steady = previous is not None and previous.status is not Status.LOST
        if status is Status.OK and steady and corner_shift(to_previous, self._shape) < _STILL_SHIFT:
            # Compared with the measured homography, never accumulated: slow drift is released after 0.2 px.
            to_previous, to_reference, status = IDENTITY, before, Status.STILL
        self._motion.update(to_previous)
        self._lost = 0
        self._unmeasured = 0 if anchored.measured else self._unmeasured + 1
        counted: AnchoredFrame | PairwiseMotion = anchored if anchored.measured or motion is None else motion
        active = None if self._anchor is None else self._anchor.keyframes.active
        to_key = IDENTITY if active is None else normalised(inverse(active.to_reference) @ to_reference)
        return self._publish(
            FrameRegistration(
                to_previous,
                to_reference,
                self._reference,
                status,
                keyframe=anchored.keyframe,
                matches=counted.matches,
                inliers=counted.inliers,
                rmse=counted.rmse,
                anchored=anchored.measured,
                key_index=0 if active is None else active.index,
                to_key=to_key,
            )
        )

    def _add_keyframe(self, images: Sequence[GreyArray], to_reference: FloatArray) -> FloatArray:
        """Changes the reference where a new keyframe makes that due, and begins an adjustment.

        Returns its homography to the present reference plane.
        """
        self._since_key = 0
        anchor = self._anchor
        if anchor is None or anchor.keyframes.active is None:
            return to_reference
        scale = scale_change(to_reference, self._shape)
        stretched = depth_ratio(to_reference, self._shape) > _MAX_DEPTH_RATIO
        if stretched or not _PLANE_SCALE[0] < scale < _PLANE_SCALE[1]:
            return self._open_plane(images, to_reference)
        reference = self._schedule.at(len(anchor.keyframes)) if self._settings.is_centred else None
        if reference is not None:
            change = anchor.keyframes.rebase(reference)
            if not np.allclose(change, IDENTITY, atol=1e-12):
                self._reference += 1
                self._move_plane(change)
                self._rebase = change
                to_reference = normalised(change @ to_reference)
        anchor.begin_adjustment(images, whole=reference is not None)
        return to_reference

    def _open_plane(self, images: Sequence[GreyArray], to_reference: FloatArray) -> FloatArray:
        """Continues on the plane of a new keyframe, without the earlier keyframes."""
        self._retire()
        self._anchor = KeyframeAnchor(self._settings, self._level)
        self._anchor.add(images, IDENTITY)
        self._schedule = ReferenceSchedule(self._settings.strip_length)
        self._reference += 1
        self._opens_plane = True
        self._move_plane(inverse(to_reference))
        return IDENTITY

    def _retire(self) -> None:
        """Keeps the keyframes of the finished plane for its mosaic."""
        if self._anchor is None:
            return
        if self._closed is not None:
            self._closed.close()
        self._closed = self._anchor.keyframes
        self._closed.retire()
        self._anchor = None

    def _move_plane(self, change: FloatArray | None) -> None:
        """Applies a change of the plane, float64[3, 3] old to new, to the registered frames."""
        if change is None:
            return
        self._base_to_reference = normalised(change @ self._base_to_reference)
        if self._previous is not None:
            moved = normalised(change @ self._previous.to_reference)
            self._previous = replace(self._previous, to_reference=moved)
        self._change = change if self._change is None else normalised(change @ self._change)

    def _predict(self) -> FrameRegistration:
        """Publishes a lost frame at its predicted homography."""
        expected = self._motion.expected(self._before)
        self._motion.predicted += 1
        to_previous = normalised(inverse(self._before) @ expected)
        return self._publish(FrameRegistration(to_previous, expected, self._reference, Status.LOST))

    def _publish(self, registered: FrameRegistration) -> FrameRegistration:
        if self._change is not None:
            registered = replace(
                registered, change=self._change, rebase=self._rebase, opens_plane=self._opens_plane
            )
        self._previous = registered
        return registered
