"""Frames of a pipeline, ours or GStreamer's."""

import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest

from streamkit import Frame

needs_gstreamer = pytest.mark.skipif(shutil.which("gst-launch-1.0") is None, reason="needs gst-launch-1.0")


def by_gstreamer(frame: Frame, line: str, shape: tuple[int, ...]) -> np.ndarray:
    """What GStreamer's element makes of a frame; rows of its buffers are padded to four bytes."""
    width, height = frame.caps["width"], frame.caps["height"]
    assert width % 8 == 0, "rows of the input are not padded"
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "in.raw"), Path(folder, "out.raw")
        source.write_bytes(np.ascontiguousarray(frame.data).tobytes())
        command = (
            f"gst-launch-1.0 -q filesrc location={source} blocksize={frame.data.nbytes} ! "
            f"rawvideoparse format={str(frame.caps['format']).lower()} width={width} height={height} ! "
            f"{line} ! filesink location={target}"
        )
        subprocess.run(command.split(), check=True, timeout=30, capture_output=True)
        return _unpadded(np.frombuffer(target.read_bytes(), np.uint8), str(frame.caps["format"]), shape)


def _unpadded(data: np.ndarray, pixel_format: str, shape: tuple[int, ...]) -> np.ndarray:
    """The rows of a buffer without the bytes that fill them up to a multiple of four."""

    def plane(start: int, rows: int, length: int) -> tuple[np.ndarray, int]:
        step = (length + 3) // 4 * 4
        return data[start : start + rows * step].reshape(rows, step)[:, :length], start + rows * step

    rows, length = shape[0], int(np.prod(shape[1:]))
    if pixel_format not in ("I420", "NV12"):
        return plane(0, rows, length)[0].reshape(shape)
    rows = rows * 2 // 3
    luma, start = plane(0, rows, length)
    if pixel_format == "NV12":
        return np.concatenate([luma, plane(start, rows // 2, length)[0]])
    u, start = plane(start, rows // 2, length // 2)
    v, _ = plane(start, rows // 2, length // 2)
    return np.concatenate([luma, np.stack([u, v]).reshape(-1, length)])
