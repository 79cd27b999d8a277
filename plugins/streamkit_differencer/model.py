"""The background model: equations 1 to 4 on the canvas, made fit for a camera that moves.

What is added to the equations: a pixel of the frame that is new to the canvas has no background until it was
quiet; comparison bears an error of registration; a thing that stands still stays foreground for a while and
then becomes background; a change of exposure is taken over instead of seen as motion.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, cast

import cv2
import numpy as np

from streamkit_differencer.changes import LONGEST_WAIT, update_waiting
from streamkit_differencer.confidence import contrasts
from streamkit_differencer.contrast import STRONG, judge
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import find_ghosts
from streamkit_differencer.filters.parallax import find_slides
from streamkit_differencer.filters.pieces import pieces_of, take_away
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.growth import grow, strong
from streamkit_differencer.illumination import exposure_step, is_another_scene
from streamkit_differencer.learning import learn
from streamkit_differencer.marks import SHADOW, mark
from streamkit_differencer.model_settings import Event, ModelSettings
from streamkit_differencer.new_ground import NO_FIRST_LOOK
from streamkit_differencer.noise import NoiseMap, first_spread
from streamkit_differencer.resampling import LastFrames, Remembered, bounds_of, filled, scrolled, warped

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from streamkit_differencer.canvas_region import Region

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    Matrix = NDArray[np.float64]
    Points = NDArray[np.float64]
    Slices = tuple[slice, slice]

# Weight of a frame in learning a pixel's noise: under a camera that flies ground is in view for seconds.
SPREAD_COEFFICIENT = 0.05
NOISE_INTERVAL = 4
WITHOUT_BACKGROUND = 22
# Of a frame that may be of another scene, so much changed.
LEAST_CUT_SHARE = 0.25
GHOST_INTERVAL = 3
# New ground waits one frame more at most, for half the time.
FIRST_LOOK_INTERVAL = 2
# Frames for which the noise of ground that comes into view is taken for the same.
FIRST_SPREAD_FRAMES = 8


class Workspace:
    """Pictures of the canvas that hold nothing from one frame to the next.

    A fresh half megabyte for each of them and every frame would cost more than what is done with it.

    Attributes:
        quiet: uint8[h, w], mask of D = 0.
        rounded: uint8[h, w], the background before the frame.
        levels: uint8[h, w], see `contrast.judge`; in the end the foreground's marks.
        mask: uint8[h, w], foreground.
        lessons: uint8[h, w], see `learning.learn`.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.quiet, self.rounded, self.levels, self.mask, self.lessons = np.zeros((5, *shape), np.uint8)


@dataclass(slots=True)
class BackgroundModel:
    """The state of every pixel of a canvas.

    Attributes:
        size: width and height of the canvas, px.
        settings: what to do.
        background: float32[h, w], B; it means nothing where it is not valid.
        noise: of each pixel of the background.
        valid: uint8[h, w], mask of the pixels whose background is known.
        standing: uint8[h, w], frames that a pixel was foreground and quiet.
        restless: uint8[h, w], how often a pixel turned lately, see `filters.flicker`.
        marks: uint8[h, w], the foreground of the last frame, on the canvas: 255 where it changed lately, 128
            where it is quiet, 50 for shadow. It holds until the next frame, within that frame's region.
        ground: uint8[h, w], what the last frame was compared with, and which region of the canvas it is.
    """

    size: tuple[int, int]
    settings: ModelSettings
    background: FloatImage = field(init=False)
    noise: NoiseMap = field(init=False)
    valid: ByteImage = field(init=False)
    standing: ByteImage = field(init=False)
    restless: ByteImage = field(init=False)
    ground: tuple[ByteImage, Slices] = field(init=False)
    _waiting: ByteImage = field(init=False)
    _foreground_before: ByteImage = field(init=False)
    _frames: int = 0
    _history: LastFrames = field(init=False)
    _work: Workspace = field(init=False)
    _first_spread: float | None = None

    def __post_init__(self) -> None:
        self._work = Workspace((self.size[1], self.size[0]))
        self.reset()

    def reset(self) -> None:
        """Forgets everything."""
        shape = self.size[1], self.size[0]
        self._first_spread, self._frames = None, 0
        self.ground = self._work.rounded, np.s_[0 : shape[0], 0 : shape[1]]
        for name, fill in self._fills().items():
            setattr(self, name, filled(shape, fill, np.uint8))
        self.background, self.noise = filled(shape, 0, np.float32), NoiseMap(shape)
        self._history = LastFrames(shape, self.settings.interval * (2 if self.settings.three_frame else 1))

    @property
    def marks(self) -> ByteImage:
        """See the class."""
        return self._work.levels

    def _fills(self) -> dict[str, int]:
        """The byte images of the canvas, and what each is where nothing is known."""
        empty = ("valid", "standing", "restless", "_foreground_before")
        return {"_waiting": LONGEST_WAIT} | dict.fromkeys(empty, 0)

    def _used(self) -> dict[str, int]:
        """Those of them that have something in them."""
        unused = set() if self.settings.flicker else {"restless", "_foreground_before"}
        if not cv2.countNonZero(self.standing):
            unused.add("standing")
        return {name: fill for name, fill in self._fills().items() if name not in unused}

    @property
    def dynamic(self) -> ByteImage:
        """D, uint8[h, w]: frames still to wait until a pixel is quiet; where no frame is, as it was there."""
        # Kept as what is left of the longest wait, so that a pixel that changed needs no branch.
        waited = np.uint8(LONGEST_WAIT - self.settings.quiet_frames)
        return np.maximum(self._waiting, waited) - waited

    def scroll(self, dx: int, dy: int) -> None:
        """Moves everything by whole pixels: what was at (x, y) is then at (x + dx, y + dy)."""
        for name, fill in self._used().items():
            setattr(self, name, scrolled(getattr(self, name), dx, dy, fill))
        self.background = scrolled(self.background, dx, dy, 0)
        self.noise.scroll(dx, dy)
        self._history.scroll(dx, dy)

    def warp(self, change: Matrix) -> None:
        """Resamples everything onto another canvas: float64[3, 3] maps this canvas to that one."""
        # Into the memory that it has: to get new memory takes as long as to fill it.
        for name, fill in self._used().items():
            image = getattr(self, name)
            image[:] = warped(image, change, fill)
        self.background[:] = warped(self.background, change, 0, cv2.INTER_CUBIC)
        self.noise.warp(change)
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid[:] = cv2.erode(self.valid, np.ones((3, 3), np.uint8))
        self._history.warp(change)

    def room(self) -> Remembered:
        """Where the next frame and its mask may be drawn on the canvas for `update`."""
        return self._history.room()

    def update(
        self, image: ByteImage, seen: ByteImage, region: Slices, way: Points | None = None
    ) -> tuple[ByteImage, Event]:
        """Takes in one frame.

        Args:
            image: uint8[h, w], the frame on the canvas within `region`.
            seen: uint8[h, w], mask of the pixels that the frame covers.
            region: rows and columns of the canvas.
            way: float64[2], px, along which things that only slide may have come, see `filters.parallax`.

        Returns:
            Foreground, uint8[h, w] of the region, which holds until the next frame: 0 background, 50 shadow,
            128 foreground that is quiet, 255 foreground that changed within `quiet_frames`; and what happened
            to the model as a whole.
        """
        event = self._follow_brightness(image, seen, region)
        frame, work, marks = self._history.place(image, seen, region), self._work, self.marks[region]
        earlier = self._earlier
        bounds = bounds_of(region, self.size)
        if self._changed(frame, earlier, region, bounds):
            self.reset()
            self._history.append(frame)
            marks[:] = 0
            return marks, Event.RESET
        self._frames += 1
        self._look_first(frame, earlier, bounds)
        self._judge(frame, bounds)
        self.ground = work.rounded[region], region
        self._leave_out(frame, earlier, bounds, way)
        mask = work.mask[region]
        shadow = shadow_mask(image, self.background[region], mask) if self.settings.shadow else None
        self._learn(frame, earlier, bounds)
        if self.settings.three_frame:
            cv2.bitwise_or(mask, self._three_frame(frame, region, bounds), dst=mask)
        self._history.append(frame)
        if self.settings.flicker:
            before = self._foreground_before[region]
            flickers = update_flicker(self.restless[region], before, mask)
            before[:] = mask
            cv2.subtract(mask, flickers, dst=mask)
        mark(work.mask, work.quiet, work.levels, bounds)
        if shadow is not None:
            marks[(shadow & mask) > 0] = SHADOW
        return marks, event

    def _changed(self, frame: Remembered, earlier: Remembered | None, region: Slices, bounds: Region) -> bool:
        """Equations 1 and 2, and whether so much changed that nothing of the model holds."""
        settings = self.settings
        # Nothing is known to be quiet that no other frame has shown.
        before = earlier or Remembered(frame.image, np.zeros_like(frame.seen))
        total, common = update_waiting(
            frame.image,
            frame.seen,
            before.image,
            before.seen,
            self._waiting,
            self._work.quiet,
            bounds,
            settings.change_threshold,
            settings.gradient_gain,
            settings.quiet_frames,
        )
        # Noise changes pixels and not the scene, a cut between like scenes the scene and not all pixels.
        if total <= min(LEAST_CUT_SHARE, settings.frame_threshold) * max(1, common):
            return False
        known = cast("ByteImage", cv2.bitwise_and(before.seen[region], frame.seen[region]))
        return is_another_scene(before.image[region], frame.image[region], known, settings.frame_threshold)

    def _look_first(self, frame: Remembered, earlier: Remembered | None, bounds: Region) -> None:
        """Ground that came into view after the model had begun."""
        settings = self.settings
        age = self._frames - settings.quiet_frames - settings.interval
        if earlier is None or age <= 0 or settings.three_frame or self._first_spread is None:
            return
        if age == 1:
            # What was in view since then and was never quiet is a busy road, not new ground.
            self.noise.spread[(frame.seen > 0) & (self.valid == 0)] = NO_FIRST_LOOK
        if age % FIRST_LOOK_INTERVAL:
            return
        self.noise.set_limits(settings.noise_gain, settings.foreground_threshold)
        known = self.background, self.valid
        self.noise.look_first(frame.seen, earlier, self._waiting, *known, bounds, self._first_spread)

    def _judge(self, frame: Remembered, bounds: Region) -> None:
        """Equation 4, grown to the whole of things."""
        settings, work = self.settings, self._work
        self.noise.set_limits(settings.noise_gain, settings.foreground_threshold)
        # Where the noise of each pixel is known it tells of the edges, too.
        gradient_gain = 0.0 if settings.noise_gain else settings.gradient_gain
        judge(
            frame.image,
            frame.seen,
            self.background,
            self.valid,
            self.noise.needed,
            work.rounded,
            work.levels,
            bounds,
            max(settings.tolerance, 0),
            gradient_gain,
            settings.weak,
        )
        if settings.tolerance > 0 and settings.weak < 1.0:
            grow(work.levels, work.lessons, work.mask, bounds)
        else:
            strong(work.levels, work.mask, bounds)

    def _leave_out(
        self, frame: Remembered, earlier: Remembered | None, bounds: Region, way: Points | None
    ) -> None:
        """Takes ghosts and what only slides away from the foreground."""
        # Ghosts stay where they are, so not every frame has to be searched.
        seeks_ghosts = self.settings.ghost and self._frames % GHOST_INTERVAL == 0
        seeks_slides = way is not None and earlier is not None
        if not (seeks_ghosts or seeks_slides):
            return
        work = self._work
        blocks, count = pieces_of(work.mask, bounds)
        ghosts = slides = np.zeros(count, np.bool_)
        if seeks_ghosts:
            ghosts = find_ghosts(frame.image, work.rounded, self.valid, work.mask, blocks, count, bounds)
        if way is not None and earlier is not None:
            slides = find_slides(
                frame.image,
                work.rounded,
                self.valid,
                earlier.image,
                earlier.seen,
                self.noise.needed,
                work.mask,
                blocks,
                count,
                bounds,
                max(self.settings.tolerance, 1),
                float(way[0]),
                float(way[1]),
            )
        take_away(blocks, ghosts, slides, work.mask, work.quiet, frame.image, self.background)

    def _learn(self, frame: Remembered, earlier: Remembered | None, bounds: Region) -> None:
        """Equation 3, what has stopped, what is new, and the noise."""
        settings, work = self.settings, self._work
        added = learn(
            frame.image,
            work.mask,
            work.quiet,
            self.background,
            self.valid,
            self.standing,
            work.lessons,
            bounds,
            settings.coefficient,
            settings.absorb_frames,
        )
        if not settings.noise_gain:
            return
        # Not every frame, but with more weight: noise does not change from one to the next.
        if self._frames % NOISE_INTERVAL == 0:
            weight = NOISE_INTERVAL * SPREAD_COEFFICIENT
            self.noise.learn(frame.image, work.rounded, work.lessons, bounds, weight)
        if added and earlier is not None:
            if self._first_spread is None or self._frames % FIRST_SPREAD_FRAMES == 0:
                top, bottom, left, right = bounds
                region = np.s_[top:bottom, left:right]
                pictures = (earlier.image, frame.image, earlier.seen, frame.seen)
                self._first_spread = first_spread(*(picture[region] for picture in pictures))
            self.noise.begin(earlier.image, work.lessons, bounds, self._first_spread)

    def contrast(self, boxes: Points, to_canvas: Matrix) -> Points:
        """How far the last frame differs from the background in some boxes, see `confidence.contrasts`.

        Args:
            boxes: float64[n, 4], x0 y0 x1 y1.
            to_canvas: float64[3, 3], from the boxes' pixels to the canvas.
        """
        if not self._history:
            return np.zeros(len(boxes))
        limits = self.settings.noise_gain, self.settings.foreground_threshold
        known = self.background, self.valid, self.noise.spread
        return contrasts(boxes, to_canvas, self._history[-1].image, *known, *limits)

    @property
    def _earlier(self) -> Remembered | None:
        """The frame of tau before; a model that has just begun is sooner done when it takes its first one."""
        count = len(self._history)
        return self._history[-min(self.settings.interval, count)] if count else None

    def _three_frame(self, frame: Remembered, region: Slices, bounds: Region) -> ByteImage:
        """Where there is no background: what differs both from tau and from twice tau frames before."""
        interval, settings = self.settings.interval, self.settings
        if len(self._history) < 2 * interval:
            return np.zeros_like(frame.image[region])
        mask = cast("ByteImage", frame.seen[region] & ~self.valid[region])
        needed = np.full_like(frame.image, WITHOUT_BACKGROUND)
        room, levels = np.zeros((2, *frame.image.shape), np.uint8)
        for earlier in (self._history[-interval], self._history[-2 * interval]):
            judge(
                frame.image,
                frame.seen,
                earlier.image.astype(np.float32),
                earlier.seen,
                needed,
                room,
                levels,
                bounds,
                max(settings.tolerance, 0),
                settings.gradient_gain,
                1.0,
            )
            mask[levels[region] != STRONG] = 0
        return mask

    def _follow_brightness(self, image: ByteImage, seen: ByteImage, region: Slices) -> Event:
        """Makes the model as bright as the frame."""
        if not self._history:
            return Event.NONE
        last = self._history[-1]
        step = exposure_step(last.image[region], image, last.seen[region], seen)
        if step is not None:
            self.background[:] = np.clip(step.gain * self.background + step.offset, 0.0, 255.0)
            self._history.follow(step.gain, step.offset)
        # Exposure that creeps leaves the last frame alone, but not a background that learns slowly.
        creep = exposure_step(self.background[region], image, self.valid[region], seen)
        if creep is not None:
            self.background[:] = np.clip(creep.gain * self.background + creep.offset, 0.0, 255.0)
        return Event.NONE if step is None and creep is None else Event.GAIN
