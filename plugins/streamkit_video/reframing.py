"""Base class of elements that scale, crop or flip frames."""

from __future__ import annotations

import dataclasses
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from streamkit import Frame, Pose, Transform, scale_metadata
from streamkit_video.dronetestsrc.truth import TrueRegistration, TrueTargets

ByteArray = NDArray[np.uint8]
IDENTITY = np.eye(3)


class ReframingTransform(Transform):
    """Carries the metadata of a frame over to the frame made of it.

    Attributes:
        keeps_view: whether the new frame shows what the old one shows.
        mapping: float64[3, 3], affine, pixels of the old frame to those of the new one; set by `configure`.
    """

    keeps_view: ClassVar[bool] = True

    @override
    def start(self) -> None:
        self.mapping = IDENTITY
        self._previous_mapping: NDArray[np.float64] | None = None

    def reframed(self, frame: Frame, data: ByteArray | None) -> Frame:
        """The frame with new pixels, and its metadata in them; None for the data is the frame unchanged."""
        previous = self.mapping if self._previous_mapping is None else self._previous_mapping
        self._previous_mapping = self.mapping
        if data is None:
            return frame
        if frame.metadata:
            frame = scale_metadata(frame, self.mapping, previous)
        if (registration := frame.get(TrueRegistration)) is not None:
            frame = frame.attach(registration.scaled(self.mapping, previous))
        if (targets := frame.get(TrueTargets)) is not None:
            frame = frame.attach(targets.scaled(self.mapping))
        if not self.keeps_view and (pose := frame.get(Pose)) is not None:
            frame = frame.attach(dataclasses.replace(pose, field_of_view=None, frame_centre=None, corners=()))
        return frame.replace(data=data, caps=self.src_caps)
