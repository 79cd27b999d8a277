"""Sequences as another camera or another hand would have made them: tests of what was fitted to the clips."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
from camera_changes import as_h264, mirrored, with_gamma, with_noise
from tracking_sequences import Step, real_names, sequences

ZOOM = 1.5
CAMERA_FRAMES = 25  # the zoomed view follows the mean of the true positions over so many
NOISE_STD = 10.0  # grey levels
H264 = {"crf": "34", "preset": "veryfast"}  # about 25 KB/s at 640x480 and 25 frames a second


def changed_sequences(
    seeds: range, name: str = "", frames: int = 9999
) -> list[tuple[str, Callable[[], Iterator[Step]]]]:
    """Name and maker of every sequence; with a change those of the real ones, after it.

    Args:
        seeds: of the rendered ones.
        name: of the change, a key of `CHANGES`; empty is none.
        frames: of each sequence at most, before the change.
    """
    kept = [each for each in sequences(seeds) if not name or each[0] in real_names()]
    apply = CHANGES.get(name, iter)
    return [(label, lambda make=make: apply(itertools.islice(make(), frames))) for label, make in kept]


def _backwards(steps: Iterator[Step]) -> Iterator[Step]:
    """From the last frame with a truth to the first one: another sequence with the same truth."""
    kept = list(steps)
    while kept[-1].hidden:
        kept.pop()
    return reversed(kept)


def _every_second(steps: Iterator[Step]) -> Iterator[Step]:
    for index, step in enumerate(steps):
        if index % 2 == 0:
            yield replace(step, step_s=2 * step.step_s)


def _mirrored(steps: Iterator[Step]) -> Iterator[Step]:
    for step in steps:
        left = step.picture.shape[1] - step.box[2] - step.box[0]
        box = np.concatenate([[left], step.box[1:]])
        yield replace(step, picture=mirrored(step.picture), box=box)


def _scaled(steps: Iterator[Step], factor: float) -> Iterator[Step]:
    for step in steps:
        rows, columns = (int(size * factor) // 2 * 2 for size in step.picture.shape[:2])
        part = step.picture[: round(rows / factor), : round(columns / factor)]
        how = cv2.INTER_AREA if factor < 1 else cv2.INTER_CUBIC
        picture = np.asarray(cv2.resize(part, (columns, rows), interpolation=how), np.uint8)
        yield replace(step, picture=picture, box=step.box * factor)


def _zoomed(steps: Iterator[Step]) -> Iterator[Step]:
    """A camera with a longer lens that keeps the target in view, in frames of the same size."""
    kept = list(steps)
    shape = np.array(kept[0].picture.shape[1::-1])
    size = (shape / ZOOM).astype(int) // 2 * 2
    boxes = np.array([step.box for step in kept])
    there = np.flatnonzero(np.isfinite(boxes).all(axis=1))
    middles = boxes[:, :2] + boxes[:, 2:] / 2
    for axis in (0, 1):
        path = np.interp(np.arange(len(kept)), there, middles[there, axis])
        wide = np.pad(path, CAMERA_FRAMES // 2, mode="edge")
        middles[:, axis] = np.convolve(wide, np.full(CAMERA_FRAMES, 1 / CAMERA_FRAMES), "valid")
    corners = np.clip(np.rint(middles - size / 2), 0, shape - size).astype(int)
    for step, (left, top) in zip(kept, corners, strict=True):
        part = np.ascontiguousarray(step.picture[top : top + size[1], left : left + size[0]])
        yield from _scaled(iter([replace(step, picture=part, box=step.box - [left, top, 0, 0])]), ZOOM)


def _relit(steps: Iterator[Step], gamma: float) -> Iterator[Step]:
    for step in steps:
        yield replace(step, picture=with_gamma(step.picture, gamma))


def _noisy(steps: Iterator[Step]) -> Iterator[Step]:
    random = np.random.default_rng(0)
    for step in steps:
        noise = NOISE_STD * random.standard_normal(step.picture.shape, np.float32)
        yield replace(step, picture=with_noise(step.picture, noise))


def _compressed(steps: Iterator[Step]) -> Iterator[Step]:
    steps, shown = itertools.tee(steps)
    for step, picture in zip(steps, as_h264((step.picture for step in shown), H264), strict=True):
        yield replace(step, picture=picture)


def _drawn(steps: Iterator[Step], factor: float = 1.0, shift: float = 0.0) -> Iterator[Step]:
    """The first window as another hand draws it: in another size, or beside the target."""
    first = next(steps)
    x, y, width, height = first.box
    middle = [x + (width - 1) / 2 + shift * width, y + (height - 1) / 2 + shift * height]
    yield replace(first, window=np.array([*middle, width * factor, height * factor, 0.0]))
    yield from steps


CHANGES: dict[str, Callable[[Iterator[Step]], Iterator[Step]]] = {
    "mirrored": _mirrored,
    "backwards": _backwards,
    "every-second": _every_second,
    "zoomed": _zoomed,
    "half": partial(_scaled, factor=0.5),
    "twice": partial(_scaled, factor=2.0),
    "brighter": partial(_relit, gamma=0.7),
    "darker": partial(_relit, gamma=1.4),
    "h264": _compressed,
    "noisy": _noisy,
    "large-box": partial(_drawn, factor=1.15),
    "small-box": partial(_drawn, factor=0.85),
    "shifted-box": partial(_drawn, shift=0.1),
}
