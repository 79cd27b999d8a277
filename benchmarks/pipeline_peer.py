"""What one would write without streamkit: cv2.VideoCapture, MOG2, and OpenCV's trackers.

    python benchmarks/pipeline_peer.py LOCATION SECONDS

Runs with OpenCV alone, also in an environment of its own with opencv-contrib for CSRT; prints one JSON line.
The delay of a live stream is relative to its first frames: wall-clock time minus stream time since then.
"""

import json
import resource
import sys
import time

import cv2
import numpy as np

MAX_TARGETS = 20
MIN_AREA = 150
MIN_OVERLAP = 0.2
MAX_MISSES = 10


def overlap(first, second):
    """Intersection over union of boxes x, y, w, h."""
    right = min(first[0] + first[2], second[0] + second[2])
    bottom = min(first[1] + first[3], second[1] + second[3])
    common = max(0, right - max(first[0], second[0])) * max(0, bottom - max(first[1], second[1]))
    return common / max(first[2] * first[3] + second[2] * second[3] - common, 1)


def boxes_of(mask):
    """Boxes of what is white."""
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [cv2.boundingRect(c) for c in contours if cv2.contourArea(c) >= MIN_AREA]


def follow(picture, found, targets, create):
    """One frame: every target is searched; a detection of none of them starts one."""
    kept = []
    for tracker, misses in targets:
        is_there, box = tracker.update(picture)
        match = next((b for b in found if is_there and overlap(box, b) >= MIN_OVERLAP), None)
        if match is not None:
            found.remove(match)
        missed = 0 if match is not None else misses + 1
        if is_there and missed < MAX_MISSES:
            kept.append((tracker, missed))
    for box in sorted(found, key=lambda b: -b[2] * b[3])[: MAX_TARGETS - len(kept)]:
        if box[2] < picture.shape[1] / 4 and box[3] < picture.shape[0] / 4:
            tracker = create()
            tracker.init(picture, box)
            kept.append((tracker, 0))
    return kept


def main():
    """Plays until the end or for so many seconds."""
    location, seconds = sys.argv[1], float(sys.argv[2])
    name = next(n for n in ("CSRT", "MIL") if hasattr(cv2, f"Tracker{n}"))
    create = getattr(cv2, f"Tracker{name}").create
    capture = cv2.VideoCapture(location)
    background = cv2.createBackgroundSubtractorMOG2(detectShadows=False)
    targets, frames, counted, lag_s, first_lag_s = [], 0, 0, 0.0, None
    began = time.monotonic()
    while time.monotonic() - began < seconds:
        is_there, picture = capture.read()
        if not is_there:
            break
        lag_s = time.monotonic() - capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3
        first_lag_s = lag_s if first_lag_s is None else min(first_lag_s, lag_s)
        targets = follow(picture, boxes_of(background.apply(picture)), targets, create)
        frames += 1
        counted += len(targets)
    elapsed = time.monotonic() - began
    usage = resource.getrusage(resource.RUSAGE_SELF)
    row = {
        "tracker": name,
        "frames_s": frames / elapsed,
        "cpu_ms": (usage.ru_utime + usage.ru_stime) / max(frames, 1) * 1e3,
        "targets": counted / max(frames, 1),
        "lag_s": lag_s - (first_lag_s or 0.0),
        "seconds": elapsed,
    }
    print(json.dumps(row))


if __name__ == "__main__":
    main()
