"""Movers on rendered traffic: framediff beside OpenCV's MOG2 and KNN, plain and on a registered canvas.

All get the same frames and, where the camera flies, the registration of `stitch`. The seeds are not those
that defaults were chosen on (1 to 9). Prints pixel F, object F and centroid error, means over the seeds.

    python benchmarks/differencer.py [seed ...]
"""

import sys
import time

import cv2
import numpy as np
import numpy.typing as npt
from rendered_traffic import FRAMES, KINDS, SHAPE, WARM_UP, Score, Traffic

from streamkit import Frame, Registration, raw_video_caps
from streamkit.testing import Harness
from streamkit_differencer.differencer import Differencer, reduced
from streamkit_differencer.element import motion as motion_of
from streamkit_differencer.element import quality
from streamkit_differencer.objects import ObjectSettings, find_objects

ByteImage = npt.NDArray[np.uint8]
FRESH_SEEDS = (21, 22, 23)
MARGIN = 0.35
NEW_FRAMES = 15
# Only what moves is in the truth: what framediff marks as stopped does not count as found.
STOPPED = 128


def registrations(frames: list[ByteImage]) -> list[Registration]:
    """What `stitch` says of each frame."""
    caps = raw_video_caps("GRAY8", SHAPE[1], SHAPE[0])
    found = []
    with Harness("stitch") as stitch:
        for number, picture in enumerate(frames):
            passed = [
                frame
                for frame in stitch.push(Frame(picture, caps, seq=number, pts=number * 40_000_000))
                if frame.seq == number and frame.data is picture
            ]
            found.append(passed[-1].get(Registration))
    return found


class Own:
    """framediff as it is set by default, or with some properties set."""

    def __init__(self, **settings: float) -> None:
        self._differencer = Differencer(own_motion=True, object_settings=ObjectSettings(**settings))

    def update(self, picture: ByteImage, place: Registration | None) -> tuple[ByteImage, np.ndarray]:
        """Mask at the frame's size, and centroids."""
        result = self._differencer.update(picture, motion_of(place, True), quality(place))
        if result is None:
            return np.zeros(SHAPE, np.uint8), np.zeros((0, 2))
        return enlarged(result.foreground), result.objects.centroids


class Peer:
    """A subtractor of OpenCV at half size, on a canvas that `stitch` registers if there is room for one."""

    def __init__(self, subtractor: object, is_registered: bool) -> None:
        self._subtractor, self._is_registered = subtractor, is_registered
        self._to_canvas: np.ndarray | None = None
        self._seen: ByteImage | None = None
        self._canvas: ByteImage | None = None

    def update(self, picture: ByteImage, place: Registration | None) -> tuple[ByteImage, np.ndarray]:
        """Mask at the frame's size, and centroids."""
        small = reduced(picture, 2)
        if place is None or not self._is_registered:
            mask = self._subtractor.apply(small)
        else:
            mask = self._on_canvas(small, place)
        mask = cv2.medianBlur(np.where(mask == 255, np.uint8(255), np.uint8(0)), 3)
        return enlarged(mask), find_objects(mask, 2, ObjectSettings()).centroids

    def _on_canvas(self, small: ByteImage, place: Registration) -> ByteImage:
        height, width = small.shape
        grid = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1.0]])
        margin = np.array([[1, 0, MARGIN * width], [0, 1, MARGIN * height], [0, 0, 1.0]])
        if self._to_canvas is None:
            self._to_canvas = margin @ np.linalg.inv(place.to_reference @ grid)
        if place.reference_change is not None:
            self._to_canvas = self._to_canvas @ np.linalg.inv(place.reference_change)
        warp = self._to_canvas @ place.to_reference @ grid
        size = round(width * (1 + 2 * MARGIN)), round(height * (1 + 2 * MARGIN))
        # Outside the frame what was seen there last stands in, so that nothing else is learnt.
        canvas = np.zeros(size[::-1], np.uint8) if self._canvas is None else self._canvas.copy()
        canvas = cv2.warpPerspective(small, warp, size, dst=canvas, borderMode=cv2.BORDER_TRANSPARENT)
        self._canvas = canvas
        mask = self._subtractor.apply(canvas)
        seen = cv2.warpPerspective(np.full_like(small, 255), warp, size)
        if self._seen is None:
            self._seen = np.zeros(seen.shape, np.uint8)
        # Ground that has just come into view counts as ground, as it does for framediff.
        self._seen = cv2.add(self._seen, seen & np.uint8(1))
        mask = np.where((self._seen > NEW_FRAMES) & (seen > 0), mask, np.uint8(0))
        return cv2.warpPerspective(
            mask, warp, (width, height), flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        )


def enlarged(mask: ByteImage) -> ByteImage:
    """To the frame's size, by nearest neighbour."""
    return cv2.resize(mask, SHAPE[::-1], interpolation=cv2.INTER_NEAREST)


def makers(kind: str) -> dict[str, object]:
    """What takes part; the peers' settings are the best of those tried on seeds 1 to 9."""
    mog = lambda: cv2.createBackgroundSubtractorMOG2(120, 36, detectShadows=False)  # noqa: E731
    knn = lambda: cv2.createBackgroundSubtractorKNN(120, 800, detectShadows=False)  # noqa: E731
    chosen = {
        "framediff": Own,
        "MOG2": lambda: Peer(mog(), False),
        "KNN": lambda: Peer(knn(), False),
    }
    if KINDS[kind].moving:
        chosen |= {
            "MOG2, registered": lambda: Peer(mog(), True),
            "KNN, registered": lambda: Peer(knn(), True),
        }
    if KINDS[kind].blocks:
        chosen["framediff parallax=0.3"] = lambda: Own(parallax=0.3)
    return chosen


def main(seeds: tuple[int, ...]) -> None:
    """Prints the table."""
    print(f"{'sequence':20} {'method':24} {'pixel F':>8} {'object F':>9} {'error px':>9} {'ms':>6}")
    for kind in KINDS:
        rows: dict[str, list[tuple[float, ...]]] = {}
        for seed in seeds:
            traffic = Traffic(KINDS[kind], seed)
            frames = [traffic.frame(index)[0] for index in range(FRAMES)]
            places = registrations(frames) if KINDS[kind].moving else [None] * FRAMES
            for name, make in makers(kind).items():
                rows.setdefault(name, []).append(run(make(), frames, places, traffic))
        for name, values in rows.items():
            pixel, objects, error, ms = np.mean(values, axis=0)
            print(f"{kind:20} {name:24} {pixel:8.3f} {objects:9.3f} {error:9.2f} {ms:6.1f}", flush=True)


def run(method, frames: list[ByteImage], places: list[Registration | None], traffic: Traffic) -> tuple:
    """Pixel F, object F, centroid error and time of one method on one sequence."""
    score, spent = Score(), []
    for index, (picture, place) in enumerate(zip(frames, places, strict=True)):
        begin = time.perf_counter()
        mask, centroids = method.update(picture, place)
        spent.append(time.perf_counter() - begin)
        if index >= WARM_UP:
            score.add(np.where(mask > STOPPED, mask, 0).astype(np.uint8), centroids, traffic, index)
    error = float(np.mean(score.errors)) if score.errors else np.nan
    measures = score.f_measure(score.pixels), score.f_measure(score.objects)
    return *measures, error, 1e3 * float(np.median(spent))


if __name__ == "__main__":
    main(tuple(int(word) for word in sys.argv[1:]) or FRESH_SEEDS)
