"""Synthetic sequences of a target on a moving textured ground, with exact positions."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 320, 240
TARGET_SIDE = 48
FRAMES = 24
NOISE = 3.0
GROUND_STEP = (1.5, -0.8)


@dataclass(frozen=True, eq=False)
class Scene:
    """A short sequence with ground truth.

    Attributes:
        frames: uint8[24, 240, 320].
        centres: float64[24, 2], x y of the target, px.
    """

    frames: NDArray[np.uint8]
    centres: NDArray[np.float64]


def make_scene(images: NDArray[np.uint8], seed: int) -> Scene:
    """Pastes images uint8[n, h, w] in sequence, 48 px wide, on a moving ground.

    The target crosses the centre on a straight line with a slow oscillation, up to about 4 px a frame; each
    image stays for 24 / n frames. The sensor noise is 3 grey levels.
    """
    generator = np.random.default_rng(seed)
    ground = _ground(generator)
    targets = [cv2.resize(one, (TARGET_SIDE, TARGET_SIDE), interpolation=cv2.INTER_AREA) for one in images]
    corners = _path(generator)
    frames = np.empty((FRAMES, HEIGHT, WIDTH), np.uint8)
    for index, (left, top) in enumerate(corners):
        shift = (20 + GROUND_STEP[0] * index, 60 + GROUND_STEP[1] * index)
        matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        frame = cv2.warpAffine(ground, matrix, (WIDTH, HEIGHT), flags=flags)
        target = targets[index * len(targets) // FRAMES]
        frame[top : top + TARGET_SIDE, left : left + TARGET_SIDE] = target
        noisy = frame + np.float32(NOISE) * generator.standard_normal(frame.shape, np.float32)
        frames[index] = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    return Scene(frames, corners.astype(np.float64) + (TARGET_SIDE - 1) / 2)


def _path(generator: np.random.Generator) -> NDArray[np.int64]:
    """int64[24, 2]: the target's top left pixel in each frame."""
    speed = generator.uniform(-2.5, 2.5, 2)
    swing, phase = generator.uniform(2.0, 5.0, 2), generator.uniform(0, 2 * np.pi, 2)
    time = np.arange(FRAMES)[:, None] - (FRAMES - 1) / 2
    middle = np.array([(WIDTH - TARGET_SIDE) / 2, (HEIGHT - TARGET_SIDE) / 2])
    return np.asarray(np.rint(middle + speed * time + swing * np.sin(0.25 * time + phase)), np.int64)


def _ground(generator: np.random.Generator) -> NDArray[np.uint8]:
    """A texture of four octaves, larger than the frame."""
    size = (WIDTH + 96, HEIGHT + 96)
    texture = np.full((size[1], size[0]), 110.0, np.float32)
    for octave, strength in ((4, 14.0), (12, 20.0), (32, 24.0), (80, 24.0)):
        coarse = generator.normal(0.0, strength, (size[1] // octave + 2, size[0] // octave + 2))
        texture += cv2.resize(coarse.astype(np.float32), size, interpolation=cv2.INTER_CUBIC)
    return np.clip(texture, 0, 255).astype(np.uint8)
