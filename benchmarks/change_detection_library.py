"""Change detection by bgslibrary: SuBSENSE, PAWCS, LOBSTER and ViBe on the sequences of change_detection.py.

pybgs is built from source against OpenCV's development files; give it an environment of its own, with
opencv-python-headless:

    STREAMKIT_DATA=... python benchmarks/change_detection_library.py [sequence ...]

Each algorithm has the library's settings. The better F of two stands in the table: of colour and of grey
frames.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time

import cv2
import numpy as np
import pybgs
from change_sequences import SHARED, Score, Sequence

ALGORITHMS = ("SuBSENSE", "PAWCS", "LOBSTER", "ViBe")


def score(sequence: Sequence, name: str, *, is_colour: bool) -> tuple[float, float]:
    """F of an algorithm on a sequence, and its ms per frame."""
    algorithm, found, spent = getattr(pybgs, name)(), Score(), []
    for frame, truth in zip(sequence.frames, sequence.truths, strict=True):
        grey = cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)
        began = time.process_time()
        mask = algorithm.apply(frame if is_colour else cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
        spent.append(time.process_time() - began)
        if truth is not None and mask.shape[:2] == truth.shape:
            found.add(mask.reshape(truth.shape), truth, sequence.region)
    return found.f_measure, 1e3 * float(np.median(spent))


def main() -> None:
    """Prints a row for each sequence, and the means."""
    os.chdir(tempfile.mkdtemp())  # the library writes its settings into the current folder
    print(f"{'sequence':14}", *(f"{name:>9} {'ms':>6}" for name in ALGORITHMS))
    rows = []
    for name in sys.argv[1:] or sorted(path.name for path in SHARED.iterdir()):
        sequence = Sequence.read(SHARED / name)
        best = [
            max(score(sequence, one, is_colour=is_colour) for is_colour in (True, False))
            for one in ALGORITHMS
        ]
        rows.append([f_measure for f_measure, _ in best])
        print(f"{name:14}", *(f"{f_measure:9.3f} {ms:6.1f}" for f_measure, ms in best), flush=True)
    print(f"{'mean':14}", *(f"{mean:9.3f} {'':6}" for mean in np.mean(rows, axis=0)))


if __name__ == "__main__":
    main()
