"""Where each picture of a stream lies on a reference plane."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np

from streamkit_stitcher.homographies import (
    IDENTITY,
    FloatArray,
    GreyArray,
    centre,
    corner_shift,
    inverse,
    normalised,
    project,
    translation,
)
from streamkit_stitcher.plane.anchoring import Anchored, KeyframeAnchor
from streamkit_stitcher.plane.settings import PlaneSettings
from streamkit_stitcher.registration.corners import CornerDetector
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.pairwise import (
    PairwiseMotion,
    WorkingImage,
    register,
    working_image,
    working_level,
)
from streamkit_stitcher.registration.patches import pyramid

_COAST_FRAMES: Final = 5
_MAX_LOST: Final = 25
_STILL_SHIFT: Final = 0.2
_VELOCITY_GAIN: Final = 0.5


class Status(StrEnum):
    """How far a placement can be trusted.

    `ok` and `still` were measured against a key picture, `weak` is only carried on by the motion since the
    picture before, `lost` is a guess, and `cut` opens another plane.
    """

    OK = "ok"
    WEAK = "weak"
    LOST = "lost"
    CUT = "cut"
    STILL = "still"


@dataclass(frozen=True, eq=False)
class Placement:
    """Where one picture lies.

    Attributes:
        to_previous: float64[3, 3], its pixels to those of the picture before it in the stream.
        to_reference: float64[3, 3], its pixels to the reference plane.
        reference: number of the reference plane, going up by one at each restart.
        status: how far the matrices can be trusted.
        keyframe: whether the picture became a key picture.
        matches: points compared.
        inliers: matches that agree with the motion.
        rmse: root mean square distance of the inliers, px.
        anchored: whether `to_reference` was measured against a key picture and not only carried forward.
    """

    to_previous: FloatArray
    to_reference: FloatArray
    reference: int
    status: Status
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float = 0.0
    anchored: bool = False


class PlaneTracker:
    """Places the pictures of a stream, one after the other, on the plane of the first usable one.

    Each picture is registered to the one before it, then measured against the current key picture at full
    size, so that errors add up per key picture and not per picture. Key pictures are kept; where the camera
    comes back to one of them it takes over again, which undoes what drift there was. A cut, a new picture
    size, or too many unplaced pictures start a new plane.

    Within a plane `previous.to_reference @ to_previous` is `to_reference`, except on a picture where an
    earlier key picture takes over: there `to_reference` steps by the drift it corrects, `to_previous` not.

    Args:
        settings: the tracker's settings.
    """

    def __init__(self, settings: PlaneSettings) -> None:
        self._settings = settings
        self._reference = 0
        self._published: Placement | None = None
        self._forget((0, 0))

    def restart(self) -> None:
        """Starts a new plane with the next picture; nothing relates it to the ones before."""
        if self._published is not None:
            self._reference += 1
            self._published = replace(
                self._published, to_reference=IDENTITY, reference=self._reference, anchored=False
            )
        self._forget((0, 0))

    def skip(self) -> Placement:
        """Places a picture that must not be looked at, by the motion of those before it; status lost."""
        return self._coast()

    def place(self, grey: GreyArray) -> Placement:
        """Places the next picture of the stream.

        Args:
            grey: uint8[h, w]; it may be a view and is not kept unless it is narrower than the working width.

        Returns:
            The placement; every matrix is finite whatever the picture shows.
        """
        shape = (int(grey.shape[0]), int(grey.shape[1]))
        if shape != self._shape:
            if self._shape != (0, 0):
                self.restart()
            self._forget(shape)
        images = pyramid((grey,), self._level + 1)
        image = working_image(images, self._level, self._detector, self._settings.max_points)
        if image.is_blank:
            return self._coast()
        if self._base is None:
            return self._begin(images, image)
        return self._continue(images, image, self._base)

    def _forget(self, shape: tuple[int, int]) -> None:
        """Drops everything learnt; pictures of `shape` come next."""
        self._shape = shape
        self._level = working_level(shape, self._settings.working_width)
        self._detector = CornerDetector()
        self._anchor = KeyframeAnchor(self._settings, self._level)
        self._base: WorkingImage | None = None
        self._base_to_reference = IDENTITY
        self._velocity = np.zeros(2)
        self._coasting = 0
        self._lost = 0

    def _begin(self, images: Sequence[GreyArray], image: WorkingImage) -> Placement:
        """Opens a plane with its first usable picture."""
        self._anchor.add(images, IDENTITY)
        self._base, self._base_to_reference = image, IDENTITY
        status = Status.OK if self._reference == 0 else Status.CUT
        return self._publish(
            Placement(IDENTITY, IDENTITY, self._reference, status, keyframe=True, anchored=True)
        )

    def _begin_again(self, images: Sequence[GreyArray], image: WorkingImage) -> Placement:
        shape = self._shape
        self.restart()
        self._forget(shape)
        return self._begin(images, image)

    def _continue(self, images: Sequence[GreyArray], image: WorkingImage, base: WorkingImage) -> Placement:
        expected = self._expected()
        gap = 1 + self._coasting
        limits = replace(self._settings.limits, max_step=min(1.0, self._settings.limits.max_step * gap))
        guess = normalised(inverse(self._base_to_reference) @ expected)
        motion = register(base, image, guess, limits)
        if motion.is_cut and gap == 1:
            return self._begin_again(images, image)
        known = motion.model is not None
        carried = normalised(self._base_to_reference @ motion.matrix) if known else expected
        anchored = self._anchor.place(images, carried, trusted=motion.model is MotionModel.HOMOGRAPHY)
        if not known and not anchored.measured:
            self._lost += 1
            if motion.is_cut or self._lost > _MAX_LOST:
                return self._begin_again(images, image)
            return self._coast()
        self._base, self._base_to_reference = image, anchored.to_reference
        return self._settle(motion, anchored)

    def _settle(self, motion: PairwiseMotion, anchored: Anchored) -> Placement:
        """Publishes a placed picture, holding the place of the one before where nothing moved."""
        previous = self._published
        before = previous.to_reference if previous is not None else IDENTITY
        to_reference = anchored.to_reference
        to_previous = normalised(inverse(before) @ to_reference)
        status = Status.OK if anchored.measured else Status.WEAK
        steady = previous is not None and previous.status is not Status.LOST
        if anchored.measured and steady and corner_shift(to_previous, self._shape) < _STILL_SHIFT:
            # Held against the measured place, never added up, so a slow drift is released after 0.2 px.
            to_previous, to_reference, status = IDENTITY, before, Status.STILL
        elif anchored.jumped and motion.model is MotionModel.HOMOGRAPHY and self._coasting == 0:
            to_previous = motion.matrix
        middle = centre(self._shape)
        step = project(to_previous, middle[np.newaxis])[0] - middle
        self._velocity += _VELOCITY_GAIN * (step - self._velocity)
        self._coasting = self._lost = 0
        counted: Anchored | PairwiseMotion = anchored if anchored.measured else motion
        return self._publish(
            Placement(
                to_previous,
                to_reference,
                self._reference,
                status,
                keyframe=anchored.keyframe,
                matches=counted.matches,
                inliers=counted.inliers,
                rmse=counted.rmse,
                anchored=anchored.measured,
            )
        )

    def _expected(self) -> FloatArray:
        """Place of the next picture if the camera goes on as it did, for a few pictures at most."""
        before = self._published.to_reference if self._published is not None else IDENTITY
        if self._coasting >= _COAST_FRAMES:
            return before
        return normalised(before @ translation(self._velocity))

    def _coast(self) -> Placement:
        before = self._published.to_reference if self._published is not None else IDENTITY
        expected = self._expected()
        self._coasting += 1
        to_previous = normalised(inverse(before) @ expected)
        return self._publish(Placement(to_previous, expected, self._reference, Status.LOST))

    def _publish(self, placement: Placement) -> Placement:
        self._published = placement
        return placement
