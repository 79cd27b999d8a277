"""Base class of elements that scale, crop or flip frames."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import cv2
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import Caps, Frame, HiddenPixels, NotNegotiated, Pose, Transform, scale_metadata
from streamkit_video.dronetestsrc.truth import TrueRegistration, TrueTargets
from streamkit_video.pixel_formats import ANY_FORMAT, ByteArray, odd_size_error, supports_size

FloatArray = NDArray[np.float64]
Size = tuple[int, int]


class ReframingTransform(Transform):
    """Makes another frame of each, and carries its metadata over; where nothing changes, frames pass.

    Attributes:
        keeps_view: whether the new frame shows what the old one shows.
    """

    sink = src = ANY_FORMAT
    keeps_view: ClassVar[bool] = True

    def mapping(self, before: Size, after: Size) -> FloatArray:
        """Pixels of the old frame, of width and height px, to those of the new one, float64[3, 3], affine.

        Raises:
            NotNegotiated: the sizes cannot be.
        """
        raise NotImplementedError

    def reframed(self, data: ByteArray, pixel_format: str, after: Size) -> ByteArray:
        """A new frame of width and height px, uint8 laid out as `pixel_format`."""
        raise NotImplementedError

    @override
    def start(self) -> None:
        self._previous_mapping: FloatArray | None = None

    @override
    def configure(self, sink_caps: Caps, src_caps: Caps) -> None:
        before, self._after = (
            (caps.integer("width"), caps.integer("height")) for caps in (sink_caps, src_caps)
        )
        self._format = str(src_caps["format"])
        self._mapping = self.mapping(before, self._after)
        self._is_same = before == self._after and np.array_equal(self._mapping, np.eye(3))
        for size in (before, self._after):
            if not self._is_same and not supports_size(self._format, *size):
                raise NotNegotiated(f"{self.name}: {odd_size_error(self._format, *size)}")

    @override
    def transform(self, frame: Frame) -> Frame:
        mapping = self._mapping
        previous = mapping if self._previous_mapping is None else self._previous_mapping
        self._previous_mapping = mapping
        if self._is_same:
            return frame
        if frame.metadata:
            frame = scale_metadata(frame, mapping, previous)
        if (hidden := frame.get(HiddenPixels)) is not None:
            mask = cv2.warpAffine(hidden.mask, mapping[:2], self._after, flags=cv2.INTER_NEAREST)
            frame = frame.attach(HiddenPixels(np.asarray(mask, np.uint8)))
        if (registration := frame.get(TrueRegistration)) is not None:
            frame = frame.attach(registration.scaled(mapping, previous))
        if (targets := frame.get(TrueTargets)) is not None:
            frame = frame.attach(targets.scaled(mapping))
        if not self.keeps_view and (pose := frame.get(Pose)) is not None:
            frame = frame.attach(dataclasses.replace(pose, field_of_view=None, frame_centre=None, corners=()))
        return frame.replace(data=self.reframed(frame.data, self._format, self._after), caps=self.src_caps)
