"""Movers on rendered traffic: framediff against OpenCV's MOG2 and KNN, plain and on a registered canvas.

All get the same frames and, where the camera flies, the registration of `stitch`; see `background_peers` for
what the peers are given beyond that. The seeds are not those that settings were chosen on (1 to 9). Prints
pixel F, object F, centroid error and processor time per frame, means over the seeds.

    python benchmarks/differencer.py [seed ...]
"""

import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt
from background_peers import Canvas, Peer, PeerSettings
from rendered_traffic import FRAMES, KINDS, SHAPE, WARM_UP, Score, Traffic

from streamkit import Frame, Registration, raw_video_caps
from streamkit.testing import Harness
from streamkit_differencer.differencer import Differencer
from streamkit_differencer.element import motion_of
from streamkit_differencer.settings import DifferencerSettings, ObjectSettings

ByteImage = npt.NDArray[np.uint8]
FRESH_SEEDS = (31, 32, 33)
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
        self._differencer = Differencer(
            DifferencerSettings(objects=ObjectSettings(**settings)), own_motion=True
        )

    def update(self, picture: ByteImage, place: Registration | None) -> tuple[ByteImage, np.ndarray]:
        """Mask at the working scale or the frame's size, and centroids."""
        result = self._differencer.update(picture, motion_of(place))
        if result is None:
            return np.zeros(SHAPE, np.uint8), np.zeros((0, 2))
        return result.foreground, result.objects.centroids


def enlarged(mask: ByteImage) -> ByteImage:
    """To the frame's size, by nearest neighbour."""
    return cv2.resize(mask, SHAPE[::-1], interpolation=cv2.INTER_NEAREST)


def peers(kind: str) -> dict[str, PeerSettings]:
    """The peers' settings for a scene: the best found on seeds 1 and 2, which are not in the table.

    Tried one after the other, each against the best so far: thresholds from 10 to 64 (MOG2) and 50 to 800
    (KNN), learning rates from 0.01 to 0.1, medians of 3 and 5, 5 and 15 new frames, full and half size. What
    had the largest sum of pixel F and object F stands here.
    """
    mog2, knn = PeerSettings("MOG2", 120, 10.0), PeerSettings("KNN", 120, 300.0, learning_rate=0.02)
    match kind:
        case "static":
            return {"MOG2": mog2, "KNN": PeerSettings("KNN", 120, 50.0, median=5)}
        case "moving + 25 blocks":
            return {"MOG2": replace(mog2, threshold=25.0), "KNN": replace(knn, threshold=800.0)}
        case "small slow":
            return {"MOG2": mog2, "KNN": replace(knn, threshold=200.0)}
        case _:
            return {"MOG2": mog2, "KNN": knn}


def methods(kind: str, places: list[Registration | None]) -> dict[str, Own | Peer]:
    """What takes part, each new."""
    chosen: dict[str, Own | Peer] = {"framediff": Own()}
    if KINDS[kind].blocks:
        chosen["framediff parallax=0"] = Own(parallax=0.0)
    for name, settings in peers(kind).items():
        chosen[name] = Peer(settings)
        if KINDS[kind].moving:
            size = SHAPE[1] // settings.scale, SHAPE[0] // settings.scale
            chosen[f"{name}, registered"] = Peer(settings, Canvas.around(places, size, settings.scale))
    return chosen


def main(seeds: tuple[int, ...]) -> None:
    """Prints the table."""
    cv2.setNumThreads(1)
    print(f"{'sequence':20} {'method':24} {'pixel F':>8} {'object F':>9} {'error px':>9} {'cpu ms':>7}")
    for kind in KINDS:
        rows: dict[str, list[tuple[float, ...]]] = {}
        for seed in seeds:
            traffic = Traffic(KINDS[kind], seed)
            frames = [traffic.frame(index)[0] for index in range(FRAMES)]
            places = registrations(frames) if KINDS[kind].moving else [None] * FRAMES
            for name, method in methods(kind, places).items():
                rows.setdefault(name, []).append(run(method, frames, places, traffic))
        for name, values in rows.items():
            pixel, objects, error, ms = np.mean(values, axis=0)
            print(f"{kind:20} {name:24} {pixel:8.3f} {objects:9.3f} {error:9.2f} {ms:7.1f}", flush=True)


def run(
    method: Own | Peer, frames: list[ByteImage], places: list[Registration | None], traffic: Traffic
) -> tuple[float, ...]:
    """Pixel F, object F, centroid error and time of one method on one sequence."""
    score, spent = Score(), []
    for index, (picture, place) in enumerate(zip(frames, places, strict=True)):
        begin = time.thread_time()
        mask, centroids = method.update(picture, place)
        spent.append(time.thread_time() - begin)
        if index >= WARM_UP:
            moving = np.where(mask > STOPPED, mask, 0).astype(np.uint8)
            score.add(enlarged(moving), centroids, traffic, index)
    error = float(np.mean(score.errors)) if score.errors else np.nan
    measures = score.f_measure(score.pixels), score.f_measure(score.objects)
    return *measures, error, 1e3 * float(np.median(spent))


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("seed", nargs="*", type=int, help="seeds of sequences; 31 to 33 if there is none")
    main(tuple(parser.parse_args().seed) or FRESH_SEEDS)
