"""One target from a first window: success, precision, errors and time, beside OpenCV's trackers.

    STREAMKIT_DATA=... python benchmarks/tracking.py [--seeds 5] [--sequences 6] [--first 500]
        [--contrib PYTHON] [--only TEXT] [--variants]

Real sequences (every folder of data/sot) run once for each seed of ours, mean and spread; rendered ones once
for each sequence. `--variants` adds the real ones backwards, from their middle, and from a shifted box.
`--contrib` names a Python with opencv-contrib-python, for CSRT and KCF. One thread.
"""

import argparse
import json
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from tracking_sequences import GONE_FROM, KINDS, FloatArray, Scores, Step, rendered, score, sequences, upright

from streamkit_tracker.observation import Observation
from streamkit_tracker.settings import TrackerSettings
from streamkit_tracker.targets import TargetState
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.window_geometry import half_turn

STEP_S = 0.04
LOST_WITHIN = 5


class Run:
    """One pass of our tracker over a sequence."""

    def __init__(self, make: Callable[[], Iterator[Step]], seed: int) -> None:
        tracker = MultiTargetTracker(TrackerSettings(seed=seed, auto_start=False))
        self.found: list[FloatArray | None] = []
        self.truth: list[FloatArray] = []
        self.turns: list[float] = []
        self.states: list[TargetState] = []
        spent: list[float] = []
        for index, step in enumerate(make()):
            grey = cv2.cvtColor(step.picture, cv2.COLOR_BGR2GRAY)
            observation = Observation(STEP_S, to_previous=step.to_previous)
            began = time.thread_time()
            if index == 0:
                reports = (tracker.start_target(grey, _first(step), observation),)
            else:
                reports = tracker.step(grey, observation)
            spent.append(time.thread_time() - began)
            self.truth.append(step.box)
            self.states.append(reports[0].state if reports else TargetState.LOST)
            window = reports[0].window if reports else None
            self.found.append(None if window is None else upright(window))
            if window is not None and step.window is not None:
                self.turns.append(abs(float(half_turn(window[4] - step.window[4]))))
        self.milliseconds = float(np.mean(spent)) * 1e3

    @property
    def scores(self) -> Scores:
        """Against the truth."""
        return score(self.found, self.truth)

    @property
    def turn(self) -> float:
        """Median error of the angle, degrees; NaN where the truth has none."""
        return float(np.degrees(np.median(self.turns))) if self.turns else float("nan")


def _first(step: Step) -> FloatArray:
    if step.window is not None:
        return step.window
    x, y, width, height = step.box
    return np.array([x + (width - 1) / 2, y + (height - 1) / 2, width, height, 0.0])


def ours(seeds: int, rendered_seeds: range, only: str, variants: bool) -> dict[str, list[list[float]]]:
    """Rows success, precision, centre error, milliseconds, angle by sequence."""
    rows: dict[str, list[list[float]]] = defaultdict(list)
    for label, make in sequences(rendered_seeds, variants):
        if only not in label:
            continue
        for seed in range(1 if label in KINDS else seeds):
            run = Run(make, seed)
            scores = run.scores
            rows[label].append(
                [scores.success, scores.precision, scores.centre_error, run.milliseconds, run.turn]
            )
    return rows


def peer(
    python: str, name: str, rendered_seeds: range, only: str, variants: bool
) -> dict[str, list[list[float]]]:
    """The same of a tracker of OpenCV, without angle."""
    script = Path(__file__).with_name("tracking_peers.py")
    command = [python, str(script), name, str(rendered_seeds.start), str(len(rendered_seeds))]
    command += [f"only={only}"] + ["variants"] * variants
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    rows: dict[str, list[list[float]]] = defaultdict(list)
    for line in done.stdout.splitlines():
        label, *numbers = json.loads(line)
        rows[label].append([*numbers, float("nan")])
    return rows


def removed(rendered_seeds: range) -> None:
    """Prints how soon a target that is gone is not reported as confirmed, and how often one that is there."""
    soon, false, frames = 0, 0, 0
    for seed in rendered_seeds:
        states = Run(lambda s=seed: rendered("removed", s), 0).states
        confirmed = [state is TargetState.CONFIRMED for state in states]
        soon += not any(confirmed[GONE_FROM + LOST_WITHIN :])
        false += confirmed[:GONE_FROM].count(False)
        frames += GONE_FROM
    print(
        f"removed: unseen within {LOST_WITHIN} frames and for good in {soon} of {len(rendered_seeds)}; "
        f"falsely unseen in {100 * false / frames:.2f} % of frames",
        flush=True,
    )


def show(method: str, rows: dict[str, list[list[float]]]) -> None:
    """Prints a row for each sequence, and the mean over the real ones."""
    real = [values for label, values in rows.items() if label not in KINDS]
    for label, values in rows.items():
        success, precision, error, spent, turn = np.array(values).T
        print(
            f"| {label} | {method} | {success.mean():.3f} ({success.std():.3f}) | {precision.mean():.3f} "
            f"| {np.median(error):.2f} | {np.median(turn):.1f} | {spent.mean():.1f} |",
            flush=True,
        )
    if real:
        mean = np.mean([np.array(values).mean(axis=0) for values in real], axis=0)
        print(
            f"| mean of the real | {method} | {mean[0]:.3f} | {mean[1]:.3f} | | | {mean[3]:.1f} |", flush=True
        )


def main() -> None:
    """Prints the tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--sequences", type=int, default=6)
    parser.add_argument("--first", type=int, default=500)
    parser.add_argument("--contrib", default="")
    parser.add_argument("--only", default="", help="sequences whose name has this in it")
    parser.add_argument("--variants", action="store_true")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    chosen = range(options.first, options.first + options.sequences)
    print("| sequence | tracker | success (spread) | precision | centre px | angle deg | ms |")
    print("|---|---|---|---|---|---|---|")
    show("particletrack", ours(options.seeds, chosen, options.only, options.variants))
    peers = [(sys.executable, "MIL")] + [
        (options.contrib, name) for name in ("CSRT", "KCF") if options.contrib
    ]
    for python, name in peers:
        show(name, peer(python, name, chosen, options.only, options.variants))
    if options.only in "removed":
        removed(range(options.first, options.first + 10))


if __name__ == "__main__":
    main()
