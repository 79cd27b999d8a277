"""Sequences with their truth as another camera would have recorded them: cropped, noisy, compressed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from camera_changes import as_h264, as_jpeg, mirrored, with_gamma, with_noise
from change_sequences import ByteImage, Sequence

NOISE_SEED = 0
CROP_SHARE = 0.6
LATE_SHARE = 0.25
WIDTH_PX = 160
EXPOSURE_SHARE, EXPOSURE_PERIODS = 0.15, 3
JPEG_QUALITY = 15
# As a live encoder, at about a tenth of the rate that x264 takes by default.
H264 = {"crf": "38", "tune": "zerolatency"}

Resize = Callable[[ByteImage, int], ByteImage]


def with_frames(change: Callable[[ByteImage], ByteImage], sequence: Sequence) -> Sequence:
    """Each frame changed by itself, where the truth stays."""
    return replace(sequence, frames=[change(frame) for frame in sequence.frames])


def part_of_time(sequence: Sequence, part: slice) -> Sequence:
    """Some of the frames, in this order."""
    return replace(sequence, frames=sequence.frames[part], truths=sequence.truths[part])


def with_geometry(change: Resize, sequence: Sequence) -> Sequence:
    """Frames, truths and region changed alike, each with the interpolation that fits it."""
    smooth, nearest = cv2.INTER_AREA, cv2.INTER_NEAREST
    return Sequence(
        sequence.name,
        [change(frame, smooth) for frame in sequence.frames],
        [None if truth is None else change(truth, nearest) for truth in sequence.truths],
        change(sequence.region.astype(np.uint8), nearest) > 0,
    )


def cropped(sequence: Sequence, is_right: bool, is_bottom: bool) -> Sequence:
    """A corner of the view."""
    height, width = (2 * round(CROP_SHARE * length / 2) for length in sequence.region.shape)
    rows = slice(-height, None) if is_bottom else slice(height)
    columns = slice(-width, None) if is_right else slice(width)
    return with_geometry(lambda image, _: np.ascontiguousarray(image[rows, columns]), sequence)


def scaled(sequence: Sequence, scale: float) -> Sequence:
    """Another resolution; even sides, as H.264 needs them."""
    height, width = (2 * round(scale * length / 2) for length in sequence.region.shape)

    def resized(image: ByteImage, interpolation: int) -> ByteImage:
        is_larger = scale > 1 and interpolation == cv2.INTER_AREA
        return cv2.resize(
            image, (width, height), interpolation=cv2.INTER_CUBIC if is_larger else interpolation
        )

    return with_geometry(resized, sequence)


def of_width(sequence: Sequence, width: int) -> Sequence:
    """Frames of a width, px."""
    return scaled(sequence, width / sequence.region.shape[1])


def noisy(sequence: Sequence, deviation: float) -> Sequence:
    """With noise of a sensor, the same for all colours, a standard deviation in grey levels."""
    random, shape = np.random.default_rng(NOISE_SEED), (*sequence.region.shape, 1)
    return with_frames(
        lambda frame: with_noise(frame, deviation * random.standard_normal(shape, np.float32)), sequence
    )


def with_exposure(sequence: Sequence) -> Sequence:
    """An exposure that rises and falls."""
    phase = np.linspace(0, 2 * np.pi * EXPOSURE_PERIODS, len(sequence.frames), endpoint=False)
    gains = iter(1 + EXPOSURE_SHARE * np.sin(phase))
    return with_frames(lambda frame: cv2.convertScaleAbs(frame, alpha=next(gains)), sequence)


def compressed(sequence: Sequence) -> Sequence:
    """Compressed as a video of a low rate."""
    return replace(sequence, frames=list(as_h264(iter(sequence.frames), H264)))


CHANGES: dict[str, Callable[[Sequence], Sequence]] = {
    "crop-upper-left": partial(cropped, is_right=False, is_bottom=False),
    "crop-lower-right": partial(cropped, is_right=True, is_bottom=True),
    "mirrored": partial(with_geometry, lambda image, _: mirrored(image)),
    "half-rate": partial(part_of_time, part=slice(None, None, 2)),
    "backwards": partial(part_of_time, part=slice(None, None, -1)),
    "late": lambda sequence: part_of_time(sequence, slice(round(LATE_SHARE * len(sequence.frames)), None)),
    "gamma-0.7": partial(with_frames, partial(with_gamma, gamma=0.7)),
    "gamma-1.4": partial(with_frames, partial(with_gamma, gamma=1.4)),
    "exposure": with_exposure,
    "noise-4": partial(noisy, deviation=4.0),
    "noise-8": partial(noisy, deviation=8.0),
    "jpeg": partial(with_frames, partial(as_jpeg, quality=JPEG_QUALITY)),
    "h264": compressed,
    "160-px": partial(of_width, width=WIDTH_PX),
    "half-size": partial(scaled, scale=0.5),
    "double-size": partial(scaled, scale=2.0),
}


def changed(sequence: Sequence, variant: str) -> Sequence:
    """The sequence in one of `CHANGES`, on which nothing was chosen."""
    return replace(CHANGES[variant](sequence), name=f"{sequence.name} {variant}")
