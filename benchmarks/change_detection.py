"""Change detection by the rules of changedetection.net: framediff beside OpenCV's MOG2 and KNN.

Of the sequence `highway` as it is, and shaken like a camera on a mast: the same frames for all, grey, from
370, scored on 470 to 1070. 50 is background; 85, 170 and what lies outside the region of interest are
left out.
framediff has its defaults in both. The peers are shown with and without shadows, raw and with a 5 x 5 median.

    STREAMKIT_DATA=... python benchmarks/change_detection.py [folder of a sequence]
"""

import os
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from streamkit_differencer.differencer import Differencer
from streamkit_differencer.mask_values import full_size

ByteImage = npt.NDArray[np.uint8]
FIRST, LAST = 370, 1070
FIRST_SCORED = 470
SHAKE_PX, SHAKE_DEGREES, SHAKE_SEED = 3.0, 0.3, 0
Sequence = list[tuple[ByteImage, ByteImage | None]]


def sequence(folder: Path) -> Sequence:
    """Frames and their truth where they are scored."""
    pairs: Sequence = []
    for path in sorted((folder / "input").iterdir()):
        number = int("".join(filter(str.isdigit, path.stem)))
        truth = folder / "groundtruth" / f"gt{number:06d}.png"
        if FIRST <= number <= LAST:
            scored = cv2.imread(str(truth), 0) if number >= FIRST_SCORED and truth.exists() else None
            pairs.append((cv2.imread(str(path), 0), scored))
    return pairs


def shaken(pairs: Sequence) -> Sequence:
    """The same seen by a camera that shakes; 85 where the truth leaves the picture."""
    random, state, result = np.random.default_rng(SHAKE_SEED), np.zeros(3), []
    for picture, truth in pairs:
        state = 0.8 * state + 0.6 * random.normal(0, [SHAKE_PX, SHAKE_PX, SHAKE_DEGREES])
        height, width = picture.shape
        matrix = cv2.getRotationMatrix2D((width / 2, height / 2), state[2], 1)
        matrix[:, 2] += state[:2]
        size = width, height
        moved = cv2.warpAffine(picture, matrix, size, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        if truth is not None:
            truth = cv2.warpAffine(truth, matrix, size, flags=cv2.INTER_NEAREST, borderValue=85)  # noqa: PLW2901
        result.append((moved, truth))
    return result


class Own:
    """framediff with its defaults."""

    def __init__(self) -> None:
        self._differencer = Differencer(own_motion=True)

    def apply(self, picture: ByteImage) -> ByteImage:
        """The mask at the frame's size."""
        result = self._differencer.update(picture, None)
        height, width = picture.shape
        return full_size(None if result is None else result.foreground, width, height)


class Peer:
    """A subtractor of OpenCV; 255 is foreground, 127 shadow."""

    def __init__(self, subtractor: cv2.BackgroundSubtractor, median: int) -> None:
        self._subtractor, self._median = subtractor, median

    def apply(self, picture: ByteImage) -> ByteImage:
        """The mask at the frame's size."""
        mask = np.where(self._subtractor.apply(picture) == 255, np.uint8(255), np.uint8(0))
        return cv2.medianBlur(mask, self._median) if self._median else mask


def methods() -> dict[str, object]:
    """What takes part, each new."""
    chosen: dict[str, object] = {"framediff": Own()}
    for name, make in (
        ("MOG2", cv2.createBackgroundSubtractorMOG2),
        ("KNN", cv2.createBackgroundSubtractorKNN),
    ):
        for shadows in (True, False):
            for median in (0, 5):
                words = f"{name}{' shadows' if shadows else ''}{' median' if median else ''}"
                chosen[words] = Peer(make(detectShadows=shadows), median)
    return chosen


def main(folder: Path) -> None:
    """Prints the table."""
    cv2.setNumThreads(1)
    region = cv2.imread(str(folder / "ROI.bmp"), 0) > 0
    still = sequence(folder)
    print(f"{'sequence':10} {'method':22} {'F':>6} {'precision':>10} {'recall':>7} {'ms':>6}")
    for name, pairs in (("as it is", still), ("shaken", shaken(still))):
        for words, method in methods().items():
            counts, spent = np.zeros(3), []
            for picture, truth in pairs:
                begin = time.perf_counter()
                mask = method.apply(picture)
                spent.append(time.perf_counter() - begin)
                if truth is not None:
                    judged = region & (truth != 85) & (truth != 170)
                    found, true = (mask > 100) & judged, (truth == 255) & judged
                    counts += [
                        np.count_nonzero(found & true),
                        np.count_nonzero(found & ~true),
                        np.count_nonzero(~found & true),
                    ]
            precision, recall = counts[0] / max(1, counts[:2].sum()), counts[0] / max(1, counts[[0, 2]].sum())
            f_measure = 2 * counts[0] / max(1, 2 * counts[0] + counts[1] + counts[2])
            ms = 1e3 * float(np.median(spent))
            print(
                f"{name:10} {words:22} {f_measure:6.3f} {precision:10.3f} {recall:7.3f} {ms:6.2f}", flush=True
            )


if __name__ == "__main__":
    shared = Path(os.environ.get("STREAMKIT_DATA", "/nonexistent")) / "data" / "change" / "highway"
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else shared)
