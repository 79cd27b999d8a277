"""Runs a tracker of OpenCV over the sequences; a file of boxes for each, which is not made twice.

    python benchmarks/tracking_peers.py FOLDER CSRT|KCF|MIL [--first 500] [--sequences 6]
        [--change NAME] [--frames 9999]

CSRT and KCF need opencv-contrib-python, which cannot be installed with opencv-python: give it an
environment of its own, where it takes the place of the other after streamkit is installed.
`tracking.py --peers FOLDER` reads the files; the options mean the same there.
"""

import argparse
import time
from pathlib import Path

import cv2
import numpy as np
from tracking_changes import CHANGES, changed_sequences
from tracking_sequences import upright


def main() -> None:
    """Follows every sequence once."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("tracker", choices=["CSRT", "KCF", "MIL"])
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--sequences", type=int, default=6)
    parser.add_argument("--change", default="", choices=["", *CHANGES])
    parser.add_argument("--frames", type=int, default=9999)
    options = parser.parse_args()
    folder = options.folder / options.tracker
    folder.mkdir(parents=True, exist_ok=True)
    cv2.setNumThreads(1)
    seeds = range(options.first, options.first + options.sequences)
    for label, make in changed_sequences(seeds, options.change, options.frames):
        path = folder / f"{label}.npz"
        if path.exists():
            continue
        tracker = getattr(cv2, f"Tracker{options.tracker}").create()
        found, truth, spent = [], [], []
        for index, step in enumerate(make()):
            truth.append(step.box)
            began = time.thread_time()
            if index == 0:
                seen, box = True, step.box if step.window is None else upright(step.window)
                tracker.init(step.picture, [round(float(value)) for value in box])
            else:
                seen, box = tracker.update(step.picture)
            spent.append(time.thread_time() - began)
            found.append(np.array(box, np.float64) if seen else np.full(4, np.nan))
        np.savez(path, found=found, truth=truth, milliseconds=1e3 * np.mean(spent))
        print(label, flush=True)


if __name__ == "__main__":
    main()
