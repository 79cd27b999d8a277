"""Camera motion measured from the frames, for frames without registration: a mast that shakes, a slow pan.

Each frame is aligned to the patches of a keyframe and not to the previous frame, so that errors do not
accumulate while the view stays. That the camera stands still is the first hypothesis: a large motion must
explain the texture of the keyframe clearly better, because traffic moves as one, too. A camera that stands
still gives the same matrix for every frame: nothing is resampled.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from streamkit_differencer.arrays import ByteImage, FloatArray
from streamkit_differencer.canvas import working_to_frame
from streamkit_differencer.image_motion import (
    HOMOGRAPHY,
    SIMILARITY,
    TURN_AND_SHIFT,
    Patches,
    corner_distance,
    pyramid,
)

# Largest step between two frames, as a share of the width.
MAX_STEP = 0.3
# A keyframe is renewed when the view moved by more of its width, or something else covers it for so long.
RENEWAL_SHIFT = 0.12
RENEWAL_FRAMES = 75
# A camera that rested stands still if the frame lies nearer than this, px; one that moved, if it lies nearer
# than the other. Resampling by less costs more than it mends.
STILL_PX, SETTLED_PX = 0.5, 0.1
# Nothing more is fitted where the first step is shorter and most patches are explained.
QUICK_STILL_PX, ENOUGH_SHARE = 0.2, 0.5
# A step of a camera that rested may be that of traffic, a small one is of noise: it must explain this many
# times what rest explains.
LARGE_STEP_PX, MIN_GAIN, LARGE_STEP_GAIN = 1.8, 1.05, 1.25
# Smallest share that a position must explain: edges of another scene that lie alike explain a seventh.
MIN_EXPLAINED = 0.18
# A zoom is taken only where it explains this many times as much as turn and shift, and so is a homography:
# foam and birds that spread over the view zoom like a camera.
FREEDOM_GAIN = 1.1
STEPS = 6
MAX_MISSED_FRAMES = 12
# Missed frames in a row, as of a blur, after which a camera that moved is searched for from the last frame
# that was placed. Not at once: the patches of an old keyframe whose trust is left are those of firm ground.
PATIENCE_FRAMES = 2
# Missed frames in a row that a pan explains, after which a camera that rested is lost; leaves that cover the
# view move as one for half as many.
PAN_FRAMES = 6
# An image without texture may be a lens that is covered for a moment.
MAX_PLAIN_FRAMES = 75


@dataclass(frozen=True, eq=False, slots=True)
class _Keyframe:
    """A frame that others are aligned to.

    Attributes:
        patches: of each level of its pyramid, finest first.
        to_plane: float64[3, 3], its position.
    """

    patches: list[Patches]
    to_plane: FloatArray

    @classmethod
    def of(cls, levels: list[ByteImage], to_plane: FloatArray) -> _Keyframe:
        """A keyframe by its pyramid and position."""
        return cls([Patches.of(level) for level in levels], to_plane)

    def aligned(self, levels: list[ByteImage], placed: FloatArray) -> tuple[FloatArray, float, float]:
        """The best position of a frame near that of the keyframe or near `placed`, and what it explains.

        Coarse levels reach farther, finer ones tell more: the best of the coarsest level and the positions
        that were known compete in the next one.
        """
        coarsest = len(levels) - 1
        starts = [self.to_plane, placed]
        positions = starts
        for level in range(coarsest, -1, -1):
            patches, image = self.patches[level], levels[level]
            fits = [
                patches.aligned(image, self.to_level(level, position), TURN_AND_SHIFT, STEPS)
                for position in positions
            ]
            best = max(fits, key=lambda fit: patches.explained(image, fit)[1])
            found = self.position_of(best, level)
            positions = [found, *starts] if level == coarsest else [found]
        explained = patches.explained(image, best)
        for basis in (SIMILARITY, HOMOGRAPHY):
            free = patches.aligned(image, best, basis, STEPS)
            more = patches.explained(image, free)
            if more[1] > FREEDOM_GAIN * explained[1]:
                best, explained = free, more
        return self.position_of(best), *explained

    def to_level(self, level: int, placed: FloatArray) -> FloatArray:
        """The keyframe's pixels to those of a frame at a position, on a level of the pyramids."""
        grid = working_to_frame(2**level)
        return np.linalg.inv(grid) @ np.linalg.inv(placed) @ self.to_plane @ grid

    def position_of(self, to_image: FloatArray, level: int = 0) -> FloatArray:
        """The position of a frame to which the keyframe's pixels are mapped, on a level of the pyramids."""
        grid = working_to_frame(2**level)
        placed = self.to_plane @ grid @ np.linalg.inv(to_image) @ np.linalg.inv(grid)
        return np.asarray(placed / placed[2, 2], np.float64)


@dataclass(slots=True)
class CameraMotion:
    """Registers each frame to a keyframe.

    Attributes:
        plane: number of the plane that frames are placed on; goes up after a cut.
    """

    plane: int = 0
    _keyframe: _Keyframe | None = None
    # The pyramid of the last frame that was placed.
    _before: list[ByteImage] = field(default_factory=list)
    _placed: FloatArray = field(default_factory=lambda: np.eye(3))
    _rests: bool = True
    _missed: int = 0
    # Frames in a row that were missed and that a pan explains.
    _panned: int = 0

    def reset(self) -> None:
        """Starts a new plane with the next frame."""
        self.plane += 1
        self._missed, self._panned, self._rests = 0, 0, True
        self._placed, self._keyframe = np.eye(3), None

    def place(self, image: ByteImage) -> FloatArray | None:
        """Registers a frame.

        Args:
            image: uint8[h, w], all of one size until `reset`.

        Returns:
            float64[3, 3], frame pixels to the plane of the first frame; the last matrix while the camera
            stands still or nothing tells of a motion. None if the image is plain, or if a camera that moved
            is lost; after some of those a new plane begins.
        """
        levels = pyramid(image)
        placed = self._placed_by(levels)
        if placed is not None:
            self._before = levels
        return placed

    def _placed_by(self, levels: list[ByteImage]) -> FloatArray | None:
        """The position by the keyframe, else by the last frame that was placed; see `place`."""
        keyframe = self._keyframe
        if keyframe is None or not len(keyframe.patches[0]):
            # Without texture the camera counts as still.
            self._keyframe = _Keyframe.of(levels, self._placed)
            return self._placed
        placed = self._fit(keyframe, levels)
        if placed is None and not self._rests and self._missed >= PATIENCE_FRAMES:
            # The keyframe is out of view, or shows water.
            keyframe = _Keyframe.of(self._before, self._placed)
            placed = self._fit(keyframe, levels)
        if placed is not None:
            return self._follow(keyframe, levels, placed)
        self._panned = self._panned + 1 if self._rests and self._is_pan(levels) else 0
        return self._miss(levels)

    def _follow(self, keyframe: _Keyframe, levels: list[ByteImage], placed: FloatArray) -> FloatArray:
        """Accepts the position of a frame by a keyframe, which stays the keyframe while it is near."""
        self._missed = self._panned = 0
        # Frames of a camera that shakes are never at the same position.
        self._rests = placed is self._placed or placed is keyframe.to_plane
        if not self._rests:
            for level, patches in enumerate(keyframe.patches):
                patches.learn(levels[level], keyframe.to_level(level, placed))
        shape = levels[0].shape
        step, away = (corner_distance(placed, other, shape) for other in (self._placed, keyframe.to_plane))
        self._placed = placed
        # A jump may be an error; the next frame is near it if it is none.
        is_far = away > RENEWAL_SHIFT * max(shape) and 2 * step < away
        self._keyframe = _Keyframe.of(levels, placed) if is_far else keyframe
        return placed

    def _miss(self, levels: list[ByteImage]) -> FloatArray | None:
        self._missed += 1
        is_plain = not len(Patches.of(levels[0]))
        if self._panned >= PAN_FRAMES:
            self._rests, self._missed = False, MAX_MISSED_FRAMES + 1
        if self._rests and not is_plain:
            # What covers the view is no motion; the keyframe may have been taken of it.
            if self._missed > RENEWAL_FRAMES:
                self._missed = 0
                self._keyframe = _Keyframe.of(levels, self._placed)
            return self._placed
        if self._missed <= (MAX_PLAIN_FRAMES if is_plain else MAX_MISSED_FRAMES):
            return None
        self.reset()
        self._keyframe = _Keyframe.of(levels, self._placed)
        return self._placed

    def _is_pan(self, levels: list[ByteImage]) -> bool:
        """Whether a frame shows most of the one before it, but elsewhere; leaves hardly move as one."""
        before = _Keyframe.of(self._before, self._placed)
        at_rest, _ = before.patches[0].explained(levels[0], np.eye(3))
        return at_rest < MIN_EXPLAINED and before.aligned(levels, self._placed)[1] >= ENOUGH_SHARE

    def _fit(self, keyframe: _Keyframe, levels: list[ByteImage]) -> FloatArray | None:
        """The frame's position by a keyframe; None if it explains too little of that."""
        image, patches = levels[0], keyframe.patches[0]
        known = [
            (position, *patches.explained(image, keyframe.to_level(0, position)))
            for position in (keyframe.to_plane, self._placed)
        ]
        at_rest, share, weight = max(known, key=lambda fit: fit[2])
        settled = STILL_PX if self._rests else SETTLED_PX
        first = keyframe.position_of(patches.aligned(image, keyframe.to_level(0, at_rest), SIMILARITY, 1))
        is_near = corner_distance(first, at_rest, image.shape) <= min(settled, QUICK_STILL_PX)
        if is_near and share >= ENOUGH_SHARE:
            return at_rest
        placed, moved_share, moved_weight = keyframe.aligned(levels, self._placed)
        step = corner_distance(placed, at_rest, image.shape)
        from_last = corner_distance(placed, self._placed, image.shape) / max(image.shape)
        gain = LARGE_STEP_GAIN if step > LARGE_STEP_PX else MIN_GAIN
        is_possible = from_last < MAX_STEP and moved_share >= MIN_EXPLAINED
        if step > settled and is_possible and moved_weight >= (gain if self._rests else 1.0) * weight:
            return placed
        return at_rest if share >= MIN_EXPLAINED else None
