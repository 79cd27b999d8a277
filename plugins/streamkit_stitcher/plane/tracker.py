"""Where each picture of a stream lies on a reference plane."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    GreyArray,
    centre,
    corner_shift,
    inverse,
    normalised,
    scale_change,
    translation,
)
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.jumps import jump
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.placement import Anchored, Placement, Status, drawn_out
from streamkit_stitcher.plane.schedule import ReferenceSchedule
from streamkit_stitcher.plane.settings import PlaneSettings, ReferenceChoice
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

_COAST_FRAMES: Final = 5
_MAX_LOST: Final = 25
_STILL_SHIFT: Final = 0.2
_VELOCITY_GAIN: Final = 0.5
_ADOPT_AFTER: Final = 10
_RECOGNISE_EVERY: Final = 2
_RECOGNISE_OFTEN: Final = 4
_RECOGNISE_RARELY: Final = 16
# Well inside of what a mosaic takes: see `mosaic.is_placeable`.
_PLANE_SCALE: Final = (0.3, 3.3)
_PLANE_TILT: Final = 1.5


class PlaneTracker:
    """Places the pictures of a stream, one after the other, on a plane.

    Each picture is measured against the current key picture at full size, near the place where the motion so
    far makes it expected; where that fails, it is registered to the picture before it, then recognised by
    what it shows. Key pictures are kept and adjusted together beside the stream; where the camera comes back
    to one of them it takes over again, which undoes what drift there was. A cut, a new picture size, or too
    many unplaced pictures start a new plane; so does a picture that the plane draws out, because errors added
    up or the camera looks ahead, but that one is related to the plane before it.

    From one picture to the next, `change @ previous.to_reference @ to_previous` is `to_reference`, with the
    identity where `change` is None: whatever moves the plane travels with the picture on which it moves.

    Args:
        settings: the tracker's settings.
    """

    def __init__(self, settings: PlaneSettings) -> None:
        # Here, and not where patches are first aligned: there the stream would wait for the compiler.
        warm_up()
        self._settings = settings
        self._reference = 0
        self._published: Placement | None = None
        self._change: FloatArray | None = None
        self._closed: KeyframeMap | None = None
        self._anchor: KeyframeAnchor | None = None
        self._exchange: FloatArray | None = None
        self._opens = False
        self._forget((0, 0))

    @property
    def model(self) -> MotionModel:
        """What the motion between pictures may be, as far as is known."""
        return MotionModel.HOMOGRAPHY if self._anchor is None else self._anchor.keyframes.model

    def restart(self) -> None:
        """Starts a new plane with the next picture; nothing relates it to the ones before."""
        if self._published is not None:
            self._reference += 1
            self._published = replace(
                self._published, to_reference=IDENTITY, reference=self._reference, anchored=False
            )
        self._forget((0, 0))

    def close(self) -> None:
        """Ends the workers."""
        for keyframes in (None if self._anchor is None else self._anchor.keyframes, self._closed):
            if keyframes is not None:
                keyframes.close()

    def take_plane(self, current: bool = False) -> KeyframeMap | None:
        """The key pictures of the plane that was left last, or of the current one; the caller finishes them.

        Args:
            current: whether the current plane is wanted; the tracker then starts anew.
        """
        if current:
            self.restart()
        closed, self._closed = self._closed, None
        return closed

    def skip(self) -> Placement:
        """Places a picture that must not be looked at, by the motion of those before it; status lost."""
        self._begin_move()
        return self._coast()

    def place(self, grey: GreyArray) -> Placement:
        """Places the next picture of the stream.

        Args:
            grey: uint8[h, w]; it may be a view and is not kept unless it is narrower than the working width.

        Returns:
            The placement; every matrix is finite whatever the picture shows.
        """
        self._begin_move()
        shape = (int(grey.shape[0]), int(grey.shape[1]))
        if shape != self._shape:
            if self._shape != (0, 0):
                self.restart()
            self._forget(shape)
        images = pyramid((grey,), self._level + 1)
        if self._anchor is None or self._base is None:
            return self._begin(images)
        self._since_key += 1
        if self._anchor.keyframes.is_adjusting and self._since_key >= _ADOPT_AFTER:
            self._move_plane(self._anchor.keyframes.adopt())
        return self._continue(images, self._anchor, self._base)

    def _begin_move(self) -> None:
        """With each picture begins anew how the plane moves under it."""
        self._change = self._exchange = None
        self._opens = False

    def _forget(self, shape: tuple[int, int]) -> None:
        """Drops everything learnt; pictures of `shape` come next."""
        self._shape = shape
        self._level = working_level(shape, self._settings.working_width)
        self._detector = CornerDetector()
        self._schedule = ReferenceSchedule(self._settings.strip_length)
        self._retire()
        self._base: GreyArray | None = None
        self._base_to_reference = IDENTITY
        self._velocity = np.eye(3)
        self._coasting = 0
        self._lost = 0
        self._unmeasured = 0
        self._since_key = 0

    def _working(self, images: Sequence[GreyArray], level: int) -> WorkingImage:
        return working_image(images, level, self._detector, self._settings.max_points)

    def _begin(self, images: Sequence[GreyArray]) -> Placement:
        """Opens a plane with its first usable picture."""
        image = self._working(images, self._level)
        if image.is_blank:
            return self._coast()
        self._anchor = KeyframeAnchor(self._settings, self._level)
        self._anchor.add(images, IDENTITY)
        self._base, self._base_to_reference = image.grey, IDENTITY
        status = Status.OK if self._reference == 0 else Status.CUT
        return self._publish(
            Placement(IDENTITY, IDENTITY, self._reference, status, keyframe=True, anchored=True)
        )

    def _begin_again(self, images: Sequence[GreyArray]) -> Placement:
        shape = self._shape
        self.restart()
        self._forget(shape)
        return self._begin(images)

    def _continue(self, images: Sequence[GreyArray], anchor: KeyframeAnchor, base: GreyArray) -> Placement:
        expected = self._expected()
        due = 0 < self._settings.keyframe_interval <= self._since_key
        followed = anchor.follow(images, expected) if self._coasting == 0 else None
        if followed is not None:
            anchored = anchor.place(images, expected, trusted=True, followed=followed, due=due)
            return self._settle(images, anchored, None)
        if is_flat(images[self._level]):
            return self._coast()
        image = self._working(images, self._level)
        if image.is_blank:
            return self._coast()
        gap = 1 + self._coasting
        limits = replace(self._settings.limits, max_step=min(1.0, self._settings.limits.max_step * gap))
        guess = normalised(inverse(self._base_to_reference) @ expected)
        earlier = replace(self._working((base,), 0), factor=image.factor)
        motion = register(earlier, image, guess, limits)
        if motion.model is None:
            motion = self._leap(earlier, image) or motion
        known = motion.model is not None
        recognised = None
        if motion.is_cut:
            recognised = anchor.recognise(image.grey)
            if recognised is None and gap == 1:
                return self._begin_again(images)
        carried = normalised(self._base_to_reference @ motion.matrix) if known else expected
        trusted = motion.model is MotionModel.HOMOGRAPHY
        anchored = anchor.place(
            images,
            carried,
            trusted or recognised is not None,
            seen=recognised,
            due=due and trusted,
            leaped=gap == 1,
        )
        if not anchored.measured and recognised is None and self._is_looked_for(known):
            recognised = anchor.recognise(image.grey)
            if recognised is not None:
                anchored = anchor.place(
                    images, carried, trusted=True, seen=recognised, due=due, leaped=gap == 1
                )
        if not (known or recognised is not None or anchored.measured):
            self._lost += 1
            self._unmeasured += 1
            if motion.is_cut or self._lost > _MAX_LOST:
                return self._begin_again(images)
            return self._coast()
        return self._settle(images, anchored, motion)

    def _is_looked_for(self, known: bool) -> bool:
        """Whether it is worth the time to look for an unmeasured picture by what it shows.

        Where the motion since the last picture is known but key pictures are not seen, as where the ground is
        no plane, this is tried ever more rarely.
        """
        count = self._unmeasured
        if known and not self._coasting and count > _RECOGNISE_OFTEN:
            return count & (count - 1) == 0 or count % _RECOGNISE_RARELY == 0
        return count % _RECOGNISE_EVERY == 0

    def _leap(self, earlier: WorkingImage, image: WorkingImage) -> PairwiseMotion | None:
        """The motion since the last picture if the camera leapt, or None."""
        shift = jump(earlier.grey, image.grey, image.factor)
        if shift is None:
            return None
        motion = register(earlier, image, shift, replace(self._settings.limits, max_step=1.0))
        return motion if motion.model is MotionModel.HOMOGRAPHY else None

    def _settle(
        self, images: Sequence[GreyArray], anchored: Anchored, motion: PairwiseMotion | None
    ) -> Placement:
        """Publishes a placed picture, holding the place of the one before where nothing moved."""
        self._move_plane(anchored.change)
        to_reference = anchored.to_reference
        if anchored.keyframe:
            to_reference = self._take_key(images, to_reference)
        previous = self._published
        before = previous.to_reference if previous is not None else IDENTITY
        self._base, self._base_to_reference = images[self._level], to_reference
        to_previous = normalised(inverse(before) @ to_reference)
        status = Status.OK if anchored.measured and anchored.sure else Status.WEAK
        steady = previous is not None and previous.status is not Status.LOST
        if status is Status.OK and steady and corner_shift(to_previous, self._shape) < _STILL_SHIFT:
            # Held against the measured place, never added up, so a slow drift is released after 0.2 px.
            to_previous, to_reference, status = IDENTITY, before, Status.STILL
        self._learn_velocity(to_previous)
        self._coasting = self._lost = 0
        self._unmeasured = 0 if anchored.measured else self._unmeasured + 1
        counted: Anchored | PairwiseMotion = anchored if anchored.measured or motion is None else motion
        active = None if self._anchor is None else self._anchor.keyframes.active
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
                key_index=0 if active is None else active.index,
                to_key=IDENTITY
                if active is None
                else normalised(inverse(active.to_reference) @ to_reference),
            )
        )

    def _take_key(self, images: Sequence[GreyArray], to_reference: FloatArray) -> FloatArray:
        """Moves the plane where a new key picture makes that due, and begins an adjustment.

        Returns:
            The key picture's place on the plane that is then the reference.
        """
        self._since_key = 0
        anchor = self._anchor
        if anchor is None or anchor.keyframes.active is None:
            return to_reference
        scale = scale_change(to_reference, self._shape)
        bent = drawn_out(to_reference, self._shape) > _PLANE_TILT
        if bent or not _PLANE_SCALE[0] < scale < _PLANE_SCALE[1]:
            return self._open_plane(images, to_reference)
        checkpoint = None
        if self._settings.reference is ReferenceChoice.CENTER:
            checkpoint = self._schedule.at(len(anchor.keyframes))
        reference = checkpoint.reference if checkpoint is not None else None
        if reference is not None:
            change = anchor.keyframes.rebase(reference)
            if not np.allclose(change, IDENTITY, atol=1e-12):
                self._reference += 1
                self._move_plane(change)
                self._exchange = change
                to_reference = normalised(change @ to_reference)
        anchor.begin_adjustment(images, whole=checkpoint is not None and checkpoint.readjust)
        return to_reference

    def _open_plane(self, images: Sequence[GreyArray], to_reference: FloatArray) -> FloatArray:
        """Goes on upon the plane of a new key picture, which knows nothing of the key pictures before it."""
        self._retire()
        self._anchor = KeyframeAnchor(self._settings, self._level)
        self._anchor.add(images, IDENTITY)
        self._schedule = ReferenceSchedule(self._settings.strip_length)
        self._reference += 1
        self._opens = True
        self._move_plane(inverse(to_reference))
        return IDENTITY

    def _retire(self) -> None:
        """Keeps of the key pictures what a mosaic of their plane needs, until somebody takes it."""
        if self._anchor is None:
            return
        if self._closed is not None:
            self._closed.close()
        self._closed = self._anchor.keyframes
        self._closed.retire()
        self._anchor = None

    def _move_plane(self, change: FloatArray | None) -> None:
        """Follows a move of the plane, float64[3, 3] old to new, with all that was placed on it."""
        if change is None:
            return
        self._base_to_reference = normalised(change @ self._base_to_reference)
        if self._published is not None:
            self._published = replace(
                self._published, to_reference=normalised(change @ self._published.to_reference)
            )
        self._change = change if self._change is None else normalised(change @ self._change)

    def _learn_velocity(self, to_previous: FloatArray) -> None:
        middle = centre(self._shape)
        centred = normalised(translation(-middle) @ to_previous @ translation(middle))
        self._velocity = self._velocity + _VELOCITY_GAIN * (centred - self._velocity)

    def _expected(self) -> FloatArray:
        """Place of the next picture if the camera goes on as it did, for a few pictures at most."""
        before = self._published.to_reference if self._published is not None else IDENTITY
        if self._coasting >= _COAST_FRAMES:
            return before
        middle = centre(self._shape)
        return normalised(before @ translation(middle) @ self._velocity @ translation(-middle))

    def _coast(self) -> Placement:
        before = self._published.to_reference if self._published is not None else IDENTITY
        expected = self._expected()
        self._coasting += 1
        to_previous = normalised(inverse(before) @ expected)
        return self._publish(Placement(to_previous, expected, self._reference, Status.LOST))

    def _publish(self, placement: Placement) -> Placement:
        if self._change is not None:
            placement = replace(placement, change=self._change, exchange=self._exchange, opens=self._opens)
        self._published = placement
        return placement
