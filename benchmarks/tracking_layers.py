"""Layered sampling against flat sampling: the same evaluations, template, motion model and sequences.

    STREAMKIT_DATA=... python benchmarks/tracking_layers.py [--sequences 6] [--first 500] [--frames 100]

Both have 364 evaluations a frame of 32x32 samples (220 + 72 + 72 in layers, or all at once in five
dimensions) and the first patch as their template; nothing else of the tracker takes part. Rendered sequences
with turn, size and light, the camera's motion taken out.
"""

import argparse
import itertools
from collections.abc import Iterator

import cv2
import numpy as np
from layered_and_flat import EVALUATIONS, GreyStep, follow
from tracking_sequences import KINDS, Step, rendered


def as_grey(steps: Iterator[Step]) -> Iterator[GreyStep]:
    """The steps of a rendered sequence as `follow` takes them."""
    for step in steps:
        assert step.window is not None
        yield cv2.cvtColor(step.picture, cv2.COLOR_BGR2GRAY), step.window, -step.to_previous[:2, 2]


def main() -> None:
    """Prints one row for each sequence and the ratio of the means."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sequences", type=int, default=6)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--frames", type=int, default=100)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    print(f"{EVALUATIONS} evaluations a frame; median errors of centre (px) and angle (degrees)")
    print("| sequence | layered | flat |")
    print("|---|---|---|")
    rows = []
    for seed in range(options.first, options.first + options.sequences):
        steps = list(as_grey(itertools.islice(rendered(KINDS[0], seed), options.frames)))
        layered = follow(steps, layered=True, seed=seed)
        flat = follow(steps, layered=False, seed=seed)
        rows.append((layered, flat))
        print(f"| {seed} | {layered[0]:.2f}, {layered[1]:.2f} | {flat[0]:.2f}, {flat[1]:.2f} |", flush=True)
    means = np.mean(rows, axis=0)
    print(
        f"layered / flat: centre {means[0, 0] / means[1, 0]:.2f}, angle {means[0, 1] / means[1, 1]:.2f} "
        "(asked: centre 0.7 or less)"
    )


if __name__ == "__main__":
    main()
