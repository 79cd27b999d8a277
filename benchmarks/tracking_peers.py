"""Runs a tracker of OpenCV over the sequences; a file of boxes for each, which is not made twice.

    python benchmarks/tracking_peers.py FOLDER CSRT|KCF|MIL FIRST_SEED SEEDS [backwards]

CSRT and KCF need opencv-contrib-python, which cannot be installed with opencv-python: give it an
environment of its own. `tracking.py --peers FOLDER` reads the files.
"""

import sys
import time
from pathlib import Path

import cv2
import numpy as np
from tracking_sequences import sequences


def main() -> None:
    """Follows every sequence once."""
    name, first, count = sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    folder = Path(sys.argv[1]) / name
    folder.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    for label, make in sequences(range(first, first + count), "backwards" in sys.argv[5:]):
        path = folder / f"{label}.npz"
        if path.exists():
            continue
        tracker = getattr(cv2, f"Tracker{name}").create()
        found, truth, spent = [], [], []
        for index, step in enumerate(make()):
            truth.append(step.box)
            began = time.thread_time()
            if index == 0:
                tracker.init(step.picture, [round(float(value)) for value in step.box])
                seen, box = True, step.box
            else:
                seen, box = tracker.update(step.picture)
            spent.append(time.thread_time() - began)
            found.append(np.array(box, np.float64) if seen else np.full(4, np.nan))
        np.savez(path, found=found, truth=truth, milliseconds=1e3 * np.mean(spent))
        print(label, flush=True)


if __name__ == "__main__":
    main()
