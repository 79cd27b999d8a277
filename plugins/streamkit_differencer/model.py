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

from streamkit_differencer.confidence import contrast_at
from streamkit_differencer.equations import (
    LONGEST_WAIT,
    foreground,
    grown,
    local_bounds,
    local_range,
    logical_matrix,
    update_background,
)
from streamkit_differencer.filters.flicker import update_flicker
from streamkit_differencer.filters.ghost import ghost_mask
from streamkit_differencer.filters.parallax import Bounds, known_around, reach, sliding_mask
from streamkit_differencer.filters.pieces import Pieces
from streamkit_differencer.filters.shadow import shadow_mask
from streamkit_differencer.illumination import exposure_step, is_another_scene
from streamkit_differencer.marks import marked
from streamkit_differencer.model_settings import Event, ModelSettings
from streamkit_differencer.noise import NoiseMap, first_spread
from streamkit_differencer.resampling import LastFrames, Remembered, parts, scrolled, warped
from streamkit_differencer.scratch import Scratch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    ByteImage = NDArray[np.uint8]
    FloatImage = NDArray[np.float32]
    Matrix = NDArray[np.float64]
    Points = NDArray[np.float64]
    Region = tuple[slice, slice]

# Weight of a frame in learning a pixel's noise: under a camera that flies ground is in view for seconds.
SPREAD_COEFFICIENT = 0.05
NOISE_INTERVAL = 4
WITHOUT_BACKGROUND = 22.0
# Of a frame that may be of another scene, so much changed.
LEAST_CUT_SHARE = 0.25
GHOST_INTERVAL = 3
SMALLEST_SIDE = 2
SHARE_STEP = 4
# Frames for which the noise of ground that comes into view is taken for the same.
FIRST_SPREAD_FRAMES = 8


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
        where: rectangles of the last frame's region that hold all of its foreground.
        ground: uint8[h, w], what the last frame was compared with, and which region of the canvas it is.
    """

    size: tuple[int, int]
    settings: ModelSettings
    background: FloatImage = field(init=False)
    noise: NoiseMap = field(init=False)
    valid: ByteImage = field(init=False)
    standing: ByteImage = field(init=False)
    restless: ByteImage = field(init=False)
    where: list[Region] = field(default_factory=list)
    ground: tuple[ByteImage, Region] = field(init=False)
    _waiting: ByteImage = field(init=False)
    _ones: ByteImage = field(init=False)
    _foreground_before: ByteImage = field(init=False)
    _frames: int = 0
    _history: LastFrames = field(init=False)
    _scratch: Scratch = field(default_factory=Scratch)
    _first_spread: float | None = None
    _ranges: ByteImage = field(init=False)
    _earlier_bounds: Bounds = field(init=False)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forgets everything."""
        shape = self.size[1], self.size[0]
        self.where, self._ones, self._first_spread = [], np.ones(shape, np.uint8), None
        self.ground = np.zeros(shape, np.uint8), np.s_[0 : shape[0], 0 : shape[1]]
        for name, fill in self._fills().items():
            setattr(self, name, np.full(shape, fill, np.uint8))
        self.background, self.noise = np.zeros(shape, np.float32), NoiseMap(shape)
        self._history = LastFrames(shape, self.settings.interval * (2 if self.settings.three_frame else 1))

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
        for name, fill in self._used().items():
            setattr(self, name, warped(getattr(self, name), change, fill))
        self.background = warped(self.background, change, 0, cv2.INTER_CUBIC)
        self.noise.warp(change)
        # Cubic resampling of the background mixes pixels across the border of what is known.
        self.valid = cast("ByteImage", cv2.erode(self.valid, np.ones((3, 3), np.uint8)))
        self._history.warp(change)

    def room(self, region: Region) -> tuple[ByteImage, ByteImage]:
        """Where the next frame and its mask may be drawn for `update`, uint8 of the region's shape each."""
        return self._history.room(region)

    def update(
        self, image: ByteImage, seen: ByteImage, region: Region, way: Points | None = None
    ) -> tuple[ByteImage, Event]:
        """Takes in one frame.

        Args:
            image: uint8[h, w], the frame on the canvas within `region`.
            seen: uint8[h, w], mask of the pixels that the frame covers.
            region: rows and columns of the canvas.
            way: float64[2], px, along which things that only slide may have come, see `filters.parallax`.

        Returns:
            Foreground, uint8[h, w] of the region: 0 background, 50 shadow, 128 foreground that is quiet, 255
            foreground that changed within `quiet_frames`; and what happened to the model as a whole.
        """
        event = self._follow_brightness(image, seen, region)
        changed, is_new = self._changed(image, seen, region)
        if is_new:
            self.reset()
            self._history.append(image, seen, region)
            return np.zeros_like(image), Event.RESET
        self._frames += 1
        quiet = self._quiet(changed, region)
        rounded, needed = self._plane("rounded", image), self._thresholds(region)
        cv2.convertScaleAbs(self.background[region], dst=rounded)
        self.ground = rounded, region
        mask = self._mask(image, seen, rounded, needed, region, way)
        shadow = shadow_mask(image, self.background[region], mask) if self.settings.shadow else None
        ground = self._plane("ground", image)
        cv2.subtract(quiet, mask, dst=ground)
        # Not every frame, but with more weight: noise does not change from one to the next.
        if self.settings.noise_gain and self._frames % NOISE_INTERVAL == 0:
            known, weight = self._plane("known", image), NOISE_INTERVAL * SPREAD_COEFFICIENT
            cv2.bitwise_and(ground, self.valid[region], dst=known)
            self.noise.learn(region, rounded, image, known, weight, self._scratch)
        self._absorb(image, mask, quiet, region)
        update_background(self.background[region], image, ground, self.settings.coefficient)
        self._accept(image, quiet, region)
        if self.settings.three_frame:
            cv2.bitwise_or(mask, self._three_frame(image, seen, region), dst=mask)
            self.where = parts(mask)
        self._history.append(image, seen, region)
        if self.settings.flicker:
            before = self._foreground_before[region]
            flickers = update_flicker(self.restless[region], before, mask)
            before[:] = mask
            cv2.subtract(mask, flickers, dst=mask)
        return marked(mask, quiet, shadow, self.where), event

    def _plane(self, name: str, image: ByteImage) -> ByteImage:
        return self._scratch.plane(name, image.shape)

    def _quiet(self, changed: ByteImage, region: Region) -> ByteImage:
        """Equation 1, and the mask of where D = 0; what the frame does not cover has changed."""
        waiting, quiet = self._waiting[region], self._plane("quiet", changed)
        # With lambda at its largest S is what a changed pixel has to wait.
        cv2.subtract(waiting, self._ones[region], dst=waiting)
        cv2.max(waiting, changed, dst=waiting)
        waited = LONGEST_WAIT - self.settings.quiet_frames
        cv2.threshold(waiting, waited, 255, cv2.THRESH_BINARY_INV, dst=quiet)
        return quiet

    def _changed(self, image: ByteImage, seen: ByteImage, region: Region) -> tuple[ByteImage, bool]:
        """Equation 2, and whether so much changed that nothing of the model holds."""
        settings = self.settings
        if not self._history:
            return seen, False
        earlier = self._earlier
        known = self._plane("known", image)
        cv2.bitwise_and(earlier.seen[region], seen, dst=known)
        lowest, highest = local_bounds(earlier.image[region], 1, self._scratch)
        self._earlier_bounds = Bounds(lowest, highest, earlier.seen[region])
        self._ranges = local_range(lowest, highest, self._scratch)
        logical = logical_matrix(
            image,
            earlier.image[region],
            settings.change_threshold,
            gradient_gain=settings.gradient_gain,
            ranges=self._ranges,
            scratch=self._scratch,
        )
        # A quarter of the rows tells the share.
        rows = np.s_[:: SHARE_STEP if len(known) >= SHARE_STEP**2 else 1]
        both = cv2.bitwise_and(logical[rows], known[rows])
        share = cv2.countNonZero(both) / max(1, cv2.countNonZero(known[rows]))
        # Noise changes pixels and not the scene, a cut between like scenes the scene and not all pixels.
        is_new = share > min(LEAST_CUT_SHARE, settings.frame_threshold) and is_another_scene(
            earlier.image[region], image, known, settings.frame_threshold
        )
        # A pixel that was not in view tau frames ago is not known to be quiet.
        cv2.bitwise_not(known, dst=known)
        cv2.bitwise_or(logical, known, dst=logical)
        return logical, is_new

    def _mask(
        self,
        image: ByteImage,
        seen: ByteImage,
        rounded: ByteImage,
        needed: float | ByteImage,
        region: Region,
        way: Points | None,
    ) -> ByteImage:
        """Equation 4, grown to the whole of things, without ghosts: in a plane of its own."""
        settings, mask, known = self.settings, self._plane("mask", image), self._plane("known", image)
        cv2.bitwise_and(seen, self.valid[region], dst=known)
        bounds = local_bounds(rounded, max(settings.tolerance, 1), self._scratch, "background")
        noisy = isinstance(needed, np.ndarray)
        found = self._foreground(image, rounded if noisy else self.background[region], needed, bounds)
        cv2.bitwise_and(found, known, dst=mask)
        if settings.tolerance > 0 and settings.weak < 1.0:
            mask, self.where = grown(
                mask, image, rounded, needed, settings.weak, known=known, scratch=self._scratch
            )
        else:
            self.where = parts(mask)
        self._leave_out(image, rounded, mask, needed, region, way, bounds)
        return mask

    def _leave_out(
        self,
        image: ByteImage,
        rounded: ByteImage,
        mask: ByteImage,
        needed: float | ByteImage,
        region: Region,
        way: Points | None,
        bounds: tuple[ByteImage, ByteImage],
    ) -> None:
        """Takes ghosts and what only slides away from the foreground."""
        # Ghosts stay where they are, so not every frame has to be searched.
        seeks_ghosts = self.settings.ghost and self._frames % GHOST_INTERVAL == 0
        way = way if self._history else None
        if min(mask.shape) < SMALLEST_SIDE or not self.where or not (seeks_ghosts or way is not None):
            return
        pieces, known = Pieces.of(mask, self.where), self.valid[region]
        ghosts = ghost_mask(image, rounded, pieces, known) if seeks_ghosts else None
        slides: ByteImage | None = None
        if way is not None:
            reliable = known_around(known, self._plane("reliable", image), pieces.parts, reach(way))
            slides = sliding_mask(image, Bounds(*bounds, reliable), self._earlier_bounds, pieces, needed, way)
        if ghosts is not None:
            update_background(self.background[region], image, ghosts, 1.0)
            cv2.subtract(mask, ghosts, dst=mask)
        if slides is not None:
            cv2.subtract(mask, slides, dst=mask)
            # Edges are learnt as soon as they stand still, or the background would fall behind.
            cv2.bitwise_and(slides, self._plane("quiet", image), dst=slides)
            update_background(self.background[region], image, slides, 1.0)

    def _absorb(self, image: ByteImage, mask: ByteImage, quiet: ByteImage, region: Region) -> None:
        """Foreground that stands still long enough becomes background."""
        standing, background = self.standing[region], self.background[region]
        if cv2.countNonZero(standing):
            # What is not foreground stands no longer.
            cv2.bitwise_and(standing, mask, dst=standing)
        for part in self.where:
            still = cv2.bitwise_and(quiet[part], mask[part])
            if not cv2.countNonZero(still):
                continue
            counts = standing[part]
            cv2.add(counts, cv2.threshold(still, 0, 1, cv2.THRESH_BINARY)[1], dst=counts)
            long = cv2.threshold(counts, self.settings.absorb_frames - 1, 255, cv2.THRESH_BINARY)[1]
            if cv2.countNonZero(cv2.bitwise_and(long, still, dst=long)):
                update_background(background[part], image[part], cast("ByteImage", long), 1.0)

    def _accept(self, image: ByteImage, quiet: ByteImage, region: Region) -> None:
        """Pixels that are quiet and have no background get this frame for one, and the noise of edges."""
        valid, new = self.valid[region], self._plane("new", image)
        cv2.subtract(quiet, valid, dst=new)
        if not cv2.countNonZero(new):
            return
        cv2.bitwise_or(valid, new, dst=valid)
        rows, columns = np.divmod(np.flatnonzero(new != 0), new.shape[1])
        self.background[region][rows, columns] = image[rows, columns]
        if self.settings.noise_gain:
            if self._first_spread is None or self._frames % FIRST_SPREAD_FRAMES == 0:
                self._first_spread = first_spread(self._earlier.image[region], image)
            self.noise.begin(region, rows, columns, self._ranges[rows, columns], self._first_spread)

    def contrast(self, points: Points) -> Points:
        """How far the last frame differs from the background, in multiples of the threshold.

        Args:
            points: float64[n, k, 2], x y on the canvas, k points in each of n objects.

        Returns:
            float64[n], the mean over those points of an object that exceed their threshold; 0 if none does.
        """
        if not self._history:
            return np.zeros(len(points))
        limits = self.settings.noise_gain, self.settings.foreground_threshold
        known = self.background, self.valid, self.noise.spread
        return contrast_at(points, self._history[-1].image, known, limits)

    def _thresholds(self, region: Region) -> float | ByteImage:
        """T_F of all pixels, or of each."""
        settings = self.settings
        if settings.noise_gain == 0.0:
            return settings.foreground_threshold
        self.noise.set_limits(settings.noise_gain, settings.foreground_threshold)
        return self.noise.needed[region]

    def _foreground(
        self,
        image: ByteImage,
        background: FloatImage | ByteImage,
        threshold: float | ByteImage,
        bounds: tuple[ByteImage, ByteImage] | None = None,
    ) -> ByteImage:
        settings = self.settings
        return foreground(
            image,
            background,
            threshold,
            tolerance=max(settings.tolerance, 0),
            # Where the noise of each pixel is known it tells of the edges, too.
            gradient_gain=0.0 if isinstance(threshold, np.ndarray) else settings.gradient_gain,
            bounds=bounds,
            scratch=self._scratch,
        )

    @property
    def _earlier(self) -> Remembered:
        """The frame of tau before; a model that has just begun is sooner done when it takes its first one."""
        return self._history[-min(self.settings.interval, len(self._history))]

    def _three_frame(self, image: ByteImage, seen: ByteImage, region: Region) -> ByteImage:
        """Where there is no background: what differs both from tau and from twice tau frames before."""
        interval = self.settings.interval
        if len(self._history) < 2 * interval:
            return np.zeros_like(image)
        mask = seen & ~self.valid[region]
        for earlier in (self._history[-interval], self._history[-2 * interval]):
            mask &= earlier.seen[region] & self._foreground(image, earlier.image[region], WITHOUT_BACKGROUND)
        return mask

    def _follow_brightness(self, image: ByteImage, seen: ByteImage, region: Region) -> Event:
        """Makes the model as bright as the frame."""
        if not self._history:
            return Event.NONE
        last = self._history[-1]
        step = exposure_step(last.image[region], image, last.seen[region], seen)
        if step is not None:
            self.background = np.clip(step.gain * self.background + step.offset, 0.0, 255.0)
            self._history.follow(step.gain, step.offset)
        # Exposure that creeps leaves the last frame alone, but not a background that learns slowly.
        creep = exposure_step(self.background[region], image, self.valid[region], seen)
        if creep is not None:
            self.background = np.clip(creep.gain * self.background + creep.offset, 0.0, 255.0)
        return Event.NONE if step is None and creep is None else Event.GAIN
