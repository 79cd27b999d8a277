"""The reference planes of a stream: which one is current, and how it changes from frame to frame."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, GreyArray, inverse, normalised
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.frame_registration import is_stretched
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.keyframes import KeyframeMatch
from streamkit_stitcher.plane.schedule import reference_at
from streamkit_stitcher.plane.settings import PlaneSettings

_SAME: Final = 1e-12


class Planes:
    """The current plane, its number and keyframes, and the earlier planes, which may be met again.

    Args:
        settings: the tracker's settings.

    Attributes:
        number: of the current plane.
        anchor: registers frames to its keyframes; None before the first frame.
        ended: number of planes that ended for good, joined ones counted once.
        keeps_earlier: whether earlier planes stay, to be met again; else each ends for good.
        before: float64[3, 3], the previous frame to the current plane.
        base: float64[3, 3], the last registered frame to the current plane.
        change: float64[3, 3], the plane of the previous frame to that of the present one; None for no change.
        rebase: the part of `change` that is one of the whole plane, or None.
        has_opened: whether the present frame starts a plane that `change` relates to the previous one.
        has_jumped: whether the plane of the present frame is unrelated to the previous one.
    """

    def __init__(self, settings: PlaneSettings) -> None:
        self._settings = settings
        self._closed: KeyframeMap | None = None
        self.number = self._last_number = self.ended = 0
        self.anchor: KeyframeAnchor | None = None
        self.keeps_earlier = True
        self.before = self.last_to_plane = IDENTITY
        self._since_key = 0
        self.begin_frame()

    def begin_frame(self) -> None:
        """Forgets the changes under the previous frame."""
        self._since_key += 1
        self.reference_change: FloatArray | None = None
        self.rebase: FloatArray | None = None
        self.has_opened = self.has_jumped = False

    def close(self) -> None:
        """Ends the threads."""
        for keyframes in (None if self.anchor is None else self.anchor.keyframes, self._closed):
            if keyframes is not None:
                keyframes.close()

    def take_closed(self) -> KeyframeMap | None:
        """The keyframes of planes that ended for good; close them."""
        closed, self._closed = self._closed, None
        return closed

    def retire(self) -> None:
        """Ends all planes for good."""
        if self.anchor is None:
            return
        if self._closed is not None:
            self._closed.close()
        self._closed = self.anchor.keyframes
        self._closed.retire()
        self.ended += len(self._closed.planes)
        self.anchor = None

    def leave(self, number: int | None = None) -> None:
        """Continues with another plane, unrelated to the current one: a new one, or that of `number`."""
        self.number = self._new_number() if number is None else number
        self.before, self.has_jumped = IDENTITY, True
        if not self.keeps_earlier:
            self.retire()

    def start(self, images: Sequence[GreyArray], level: int) -> None:
        """Makes a frame the first of the current plane; `level` is that of working size."""
        if self.anchor is None:
            self.anchor = KeyframeAnchor(self._settings, level, self.number)
        self.anchor.keyframes.begin_plane(self.number)
        self.anchor.add(images, IDENTITY)
        self.last_to_plane, self._since_key = IDENTITY, 0

    def recognise(self, images: Sequence[GreyArray], anchor: KeyframeAnchor) -> KeyframeMatch | None:
        """Matches a frame by features; the plane of the matching keyframe becomes current."""
        recognised = anchor.recognise(images)
        if recognised is not None and anchor.keyframes.plane != self.number:
            self.leave(anchor.keyframes.plane)
        return recognised

    def adopt(self, change: FloatArray | None) -> None:
        """Follows an adjustment of keyframes, and the current plane where it joined another."""
        self._move(change)
        joined = self.anchor is not None and self.anchor.keyframes.plane != self.number
        if change is not None and joined:
            self._follow_number(change)

    def add_keyframe(
        self, anchor: KeyframeAnchor, images: Sequence[GreyArray], to_reference: FloatArray, level: int
    ) -> FloatArray:
        """Changes the reference where a new keyframe makes that due, and begins an adjustment.

        Returns its homography to the present reference plane.
        """
        since_key, self._since_key = self._since_key, 0
        keyframes, shape = anchor.keyframes, (images[0].shape[0], images[0].shape[1])
        if is_stretched(to_reference, shape):
            return self._open(images, to_reference, level)
        number = (
            reference_at(len(keyframes), self._settings.strip_length) if self._settings.is_centred else None
        )
        reference = None if number is None else keyframes.reference_of(number)
        if reference is not None:
            matrix = keyframes.homographies.get(reference, IDENTITY)
            if not np.allclose(matrix, IDENTITY, atol=_SAME):
                to_reference = self._moved(keyframes.rebase(reference, self._new_number()), to_reference)
        keyframes.begin_adjustment(
            images, anchor.description, whole=reference is not None, is_sparse=since_key == 1
        )
        return to_reference

    def _open(self, images: Sequence[GreyArray], to_reference: FloatArray, level: int) -> FloatArray:
        """Continues on the plane of a new keyframe."""
        self.number, self.has_opened = self._new_number(), True
        if not self.keeps_earlier:
            self.retire()
        self.start(images, level)
        self._move(inverse(to_reference))
        return IDENTITY

    def _new_number(self) -> int:
        self._last_number += 1
        return self._last_number

    def _moved(self, change: FloatArray, to_reference: FloatArray) -> FloatArray:
        """A frame's homography after a change of the whole plane, old to new."""
        self._move(change)
        self._follow_number(change)
        return normalised(change @ to_reference)

    def _follow_number(self, change: FloatArray) -> None:
        """Takes over the number of the plane that `change` has led to."""
        if self.anchor is not None:
            self.number = self.anchor.keyframes.plane
        self.rebase = change if self.rebase is None else normalised(change @ self.rebase)

    def _move(self, change: FloatArray | None) -> None:
        """Applies a change of the plane, float64[3, 3] old to new, to the registered frames."""
        if change is None:
            return
        self.last_to_plane, self.before = (
            normalised(change @ self.last_to_plane),
            normalised(change @ self.before),
        )
        self.reference_change = (
            change if self.reference_change is None else normalised(change @ self.reference_change)
        )
