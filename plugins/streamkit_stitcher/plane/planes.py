"""The reference planes of a stream: which one is current, and how it changes from frame to frame."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, GreyArray, inverse, normalised
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.frame_registration import is_stretched
from streamkit_stitcher.plane.keyframe_map import KeyframeMap
from streamkit_stitcher.plane.schedule import reference_at
from streamkit_stitcher.plane.settings import PlaneSettings

_SAME: Final = 1e-12


class Planes:
    """The current plane, its number and keyframes, and the earlier planes, which may be met again.

    Args:
        settings: of the registration.

    Attributes:
        number: of the current plane.
        anchor: places frames by its keyframes; None before the first frame.
        ended: number of planes that ended for good, joined ones counted once.
        keeps_earlier: whether earlier planes stay, to be met again; else each ends for good.
        before: float64[3, 3], the previous frame to the current plane.
        last_to_plane: float64[3, 3], the last frame that was not lost to the current plane.
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
        self.begin_frame()

    def begin_frame(self) -> None:
        """Forgets the changes under the previous frame."""
        self.change: FloatArray | None = None
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
        self._closed, self.anchor = self.anchor.keyframes, None
        self._closed.retire()
        self.ended += len(self._closed.planes)

    def leave(self, number: int | None = None) -> None:
        """Continues with another plane, unrelated to the current one: a new one, or that of `number`."""
        self.number = self._new_number() if number is None else number
        self.before, self.has_jumped = IDENTITY, True
        self.change = self.rebase = None
        if number is None and not self.keeps_earlier:
            self.retire()

    def start(self, images: Sequence[GreyArray], level: int) -> None:
        """Makes a frame the first of the current plane; `level` is that of working size."""
        if self.anchor is None:
            self.anchor = KeyframeAnchor(self._settings, level, self.number)
        self.anchor.keyframes.adopt()
        self.anchor.keyframes.plane = self.number
        self.anchor.add(images, IDENTITY)
        self.last_to_plane = IDENTITY

    def adopt(self, anchor: KeyframeAnchor, change: FloatArray) -> None:
        """Follows a change of the plane, old to new, and the current plane where it joined another."""
        self._move(change)
        if anchor.keyframes.plane != self.number:
            self._follow_number(anchor, change)

    def add_keyframe(
        self,
        anchor: KeyframeAnchor,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        level: int,
    ) -> FloatArray:
        """Changes the reference where a new keyframe makes that due, and begins an adjustment.

        Returns its homography to the present reference plane.
        """
        keyframes, shape = anchor.keyframes, (images[0].shape[0], images[0].shape[1])
        if is_stretched(to_reference, shape):
            # The keyframe starts a plane that is related to the previous one.
            self.number, self.has_opened = self._new_number(), True
            if not self.keeps_earlier:
                self.retire()
            self.start(images, level)
            self._move(inverse(to_reference))
            return IDENTITY
        number = (
            reference_at(len(keyframes), self._settings.strip_length) if self._settings.is_centred else None
        )
        reference = None if number is None else keyframes.reference_of(number)
        if reference is not None and not np.allclose(keyframes.homographies[reference], IDENTITY, atol=_SAME):
            change = keyframes.rebase(reference, self._new_number())
            self._move(change)
            self._follow_number(anchor, change)
            to_reference = normalised(change @ to_reference)
        keyframes.begin_adjustment(anchor.features is not None, reference is not None, not anchor.is_video)
        return to_reference

    def _new_number(self) -> int:
        self._last_number += 1
        return self._last_number

    def _follow_number(self, anchor: KeyframeAnchor, change: FloatArray) -> None:
        """Takes over the number of the plane that `change` has led to."""
        self.number = anchor.keyframes.plane
        self.rebase = change if self.rebase is None else normalised(change @ self.rebase)

    def _move(self, change: FloatArray) -> None:
        """Applies a change of the plane, float64[3, 3] old to new, to the registered frames."""
        self.last_to_plane = normalised(change @ self.last_to_plane)
        self.before = normalised(change @ self.before)
        self.change = change if self.change is None else normalised(change @ self.change)
