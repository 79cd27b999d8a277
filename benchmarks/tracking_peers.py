"""Runs a tracker of OpenCV over the sequences; one JSON row for each on stdout.

    python benchmarks/tracking_peers.py MIL|CSRT|KCF FIRST_SEED SEEDS [variants] [only=TEXT]

CSRT and KCF need opencv-contrib-python, which cannot live beside opencv-python: give it an environment of its
own and name its interpreter to `tracking.py --contrib`.
"""

import json
import sys
import time

import cv2
import numpy as np
from tracking_sequences import FloatArray, score, sequences


def main() -> None:
    """Follows every sequence once."""
    name, first, count = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    only = next((text[5:] for text in sys.argv[4:] if text.startswith("only=")), "")
    cv2.setNumThreads(1)
    for label, make in sequences(range(first, first + count), "variants" in sys.argv[4:]):
        if only not in label:
            continue
        tracker = getattr(cv2, f"Tracker{name}").create()
        found: list[FloatArray | None] = []
        truth: list[FloatArray] = []
        spent = 0.0
        for index, step in enumerate(make()):
            truth.append(step.box)
            began = time.thread_time()
            if index == 0:
                tracker.init(step.picture, [round(float(value)) for value in step.box])
                seen, box = True, step.box
            else:
                seen, box = tracker.update(step.picture)
            spent += time.thread_time() - began
            found.append(np.array(box, np.float64) if seen else None)
        scores = score(found, truth)
        row = [label, scores.success, scores.precision, scores.centre_error, spent / len(truth) * 1e3]
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
