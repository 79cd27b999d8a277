"""Frames as another camera would have made them: brightness, noise, compression."""

import itertools
from collections import deque
from collections.abc import Iterator
from fractions import Fraction

import av
import cv2
import numpy as np
import numpy.typing as npt

ByteImage = npt.NDArray[np.uint8]  # [h, w], grey, or [h, w, 3], BGR
FRAME_TIME = Fraction(1, 25)
REPEATABLE = {"bf": "0"}  # with B-frames the bytes of x264 differ between runs


def mirrored(frame: ByteImage) -> ByteImage:
    """Left and right exchanged."""
    return np.ascontiguousarray(frame[:, ::-1])


def with_gamma(frame: ByteImage, gamma: float) -> ByteImage:
    """With another tone curve; below 1 it is brighter."""
    curve = np.rint(255 * (np.arange(256) / 255) ** gamma).astype(np.uint8)
    return curve[frame]


def with_noise(frame: ByteImage, noise: npt.NDArray[np.float32]) -> ByteImage:
    """With added noise, grey levels, of a shape that broadcasts to that of the frame."""
    return np.clip(np.rint(frame + noise), 0, 255).astype(np.uint8)


def as_jpeg(frame: ByteImage, quality: int) -> ByteImage:
    """Compressed by itself, of a quality from 0 to 100."""
    _, packet = cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(packet, cv2.IMREAD_UNCHANGED), np.uint8)


def as_h264(frames: Iterator[ByteImage], options: dict[str, str]) -> Iterator[ByteImage]:
    """Compressed by x264, one frame for each; a row or column is cut off where their number is odd.

    Args:
        frames: of one size.
        options: of x264.
    """
    encoder, decoder = av.CodecContext.create("libx264", "w"), av.CodecContext.create("h264", "r")
    encoder.pix_fmt, encoder.framerate, encoder.time_base = "yuv420p", 1 / FRAME_TIME, FRAME_TIME
    encoder.options, encoder.thread_count = {**REPEATABLE, "threads": "1", **options}, 1
    decoder.thread_count = 1
    are_grey = deque[bool]()
    for index, frame in enumerate(itertools.chain(frames, [None])):
        shown = None
        if frame is not None:
            even = np.ascontiguousarray(frame[: len(frame) // 2 * 2, : frame.shape[1] // 2 * 2])
            if index == 0:
                encoder.height, encoder.width = even.shape[:2]
            are_grey.append(even.ndim == 2)
            shown = video_frame(even, index, FRAME_TIME)
        packets = [*encoder.encode(shown), *([] if shown else [None])]
        for decoded in (each for packet in packets for each in decoder.decode(packet)):
            yield _image(decoded, is_grey=are_grey.popleft())


def video_frame(image: ByteImage, index: int, step: Fraction) -> av.VideoFrame:
    """An image as a frame of a video, with `step` seconds between frames."""
    if image.ndim == 2:
        frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
    else:
        frame = av.VideoFrame.from_ndarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420), format="yuv420p")
    frame.pts, frame.time_base = index, step
    return frame


def _image(frame: av.VideoFrame, *, is_grey: bool) -> ByteImage:
    if is_grey:
        return np.ascontiguousarray(frame.to_ndarray(format="gray"))
    return np.asarray(cv2.cvtColor(frame.to_ndarray(format="yuv420p"), cv2.COLOR_YUV2BGR_I420), np.uint8)
