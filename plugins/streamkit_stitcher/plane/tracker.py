"""Registration of each frame of a stream to a reference plane."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, GreyArray, corner_shift, inverse, normalised
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.correlation_shift import motion_since
from streamkit_stitcher.plane.frame_registration import OK_STD, AnchoredFrame, FrameRegistration, Status
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import KeyframeMatch
from streamkit_stitcher.plane.levelling import is_stretched, levelling_due
from streamkit_stitcher.plane.motion_prediction import MotionPredictor
from streamkit_stitcher.plane.recognition_pauses import CheckPauses, is_recognition_due
from streamkit_stitcher.plane.schedule import ReferenceSchedule
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.corners import CornerDetector
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import (
    PairwiseMotion,
    WorkingImage,
    is_flat,
    working_image,
    working_level,
)
from streamkit_stitcher.registration.patches import pyramid
from streamkit_stitcher.warm_up import warm_up

_MAX_LOST: Final = 25
# Growth of the predicted error with each lost frame, px.
_LOST_STD: Final = 1.0
_STILL_SHIFT: Final = 0.2
# Patches that agree, as a part of those in view, which no mover can outvote.
_DOMINANT: Final = 0.75
# Share of the contrast that agrees with a dense alignment: certainly, and beyond chance.
_AGREEING: Final = 0.2
_RELATED: Final = 0.12
_ADOPT_AFTER: Final = 10


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
        self._motion, self._checks = MotionPredictor(shape), CheckPauses()
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
        consecutive = self._motion.predicted == 0
        aligned = self._aligned(images, anchor, expected) if consecutive else None
        if aligned is not None and aligned.share >= _AGREEING:
            anchored = anchor.register(images, expected, trusted=True, followed=aligned, due=due)
            return self._accept(images, anchored, None)
        if is_flat(images[self._level]):
            return self._predict()
        image = self._working_image(images, self._level)
        if image.is_blank:
            return self._predict()
        earlier = replace(self._working_image((base,), 0), factor=image.factor)
        guess = normalised(inverse(self._base_to_reference) @ expected)
        motion = motion_since(earlier, image, guess, self._settings.limits, self._motion.predicted)
        known = motion.model is not None
        if aligned is not None and aligned.share >= _RELATED:
            # Movers may win among the corners: the area decides.
            measured = normalised(self._base_to_reference @ motion.matrix) if known else expected
            aligned = anchor.align(images[self._level], self._before, self._std_before, measured, None)
        if aligned is not None and aligned.share >= _RELATED:
            anchored = anchor.register(images, expected, trusted=True, followed=aligned, due=due)
            return self._accept(images, anchored, None)
        recognised = None
        if motion.is_cut:
            recognised = anchor.recognise(images)
            if recognised is None and consecutive:
                return self._restart_plane(images)
        predicted = normalised(self._base_to_reference @ motion.matrix) if known else expected
        std = motion.rmse * motion.matches / max(1, motion.inliers) if known else _LOST_STD
        std += self._std_before
        trusted = motion.model is MotionModel.HOMOGRAPHY
        place = partial(anchor.register, images, predicted, consecutive=consecutive, predicted_std=std)
        anchored = place(trusted or recognised is not None, recognised=recognised, due=due and trusted)
        is_open = not (anchored.measured or anchored.keyframe or recognised is not None)
        if is_open and is_recognition_due(self._unmeasured, known and consecutive):
            recognised = anchor.recognise(images)
            if recognised is not None:
                anchored = place(trusted=True, recognised=recognised, due=due)
        if not (known or recognised is not None or anchored.measured):
            self._lost += 1
            self._unmeasured += 1
            if motion.is_cut or self._lost > _MAX_LOST:
                return self._restart_plane(images)
            return self._predict()
        return self._accept(images, anchored, motion)

    def _aligned(
        self, images: Sequence[GreyArray], anchor: KeyframeAnchor, expected: FloatArray
    ) -> KeyframeMatch | None:
        """The match near the prediction: by patches, and by the whole area where fewer of them agree."""
        followed = anchor.follow(images, expected)
        if followed is not None and (followed.share >= _DOMINANT or not self._checks.is_due()):
            return followed
        aligned = anchor.align(images[self._level], self._before, self._std_before, expected, followed)
        self._checks.add(aligned is followed)
        return aligned

    @property
    def _std_before(self) -> float:
        """Predicted error of the previous frame, px."""
        return 0.0 if self._previous is None else self._previous.corner_std

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
        certain = anchored.measured and anchored.certain and anchored.corner_std <= OK_STD
        status = Status.OK if certain else Status.WEAK
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
                corner_std=anchored.corner_std,
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
        keys = [keyframe.to_reference for keyframe in anchor.keyframes.stored]
        levelled = levelling_due([*keys, to_reference], self._shape)
        if levelled is not None:
            anchor.keyframes.level(levelled)
            to_reference = self._rebase_plane(levelled, to_reference)
        if is_stretched(to_reference, self._shape):
            return self._open_plane(images, to_reference)
        reference = self._schedule.at(len(anchor.keyframes)) if self._settings.is_centred else None
        if reference is not None:
            change = anchor.keyframes.rebase(reference)
            if not np.allclose(change, IDENTITY, atol=1e-12):
                to_reference = self._rebase_plane(change, to_reference)
        anchor.begin_adjustment(images, whole=reference is not None)
        return to_reference

    def _rebase_plane(self, change: FloatArray, to_reference: FloatArray) -> FloatArray:
        """Moves the whole plane, old to new; returns the new homography of a frame."""
        self._reference += 1
        self._move_plane(change)
        self._rebase = change if self._rebase is None else normalised(change @ self._rebase)
        return normalised(change @ to_reference)

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
        std = self._std_before + corner_shift(to_previous, self._shape) + _LOST_STD
        return self._publish(
            FrameRegistration(to_previous, expected, self._reference, Status.LOST, corner_std=std)
        )

    def _publish(self, registered: FrameRegistration) -> FrameRegistration:
        if self._change is not None:
            registered = replace(
                registered, change=self._change, rebase=self._rebase, opens_plane=self._opens_plane
            )
        self._previous = registered
        return registered
