"""How much code a frame passes through, and what a pipeline imports."""

import subprocess
import sys
from types import CodeType, FrameType, ModuleType

import numpy as np

from streamkit_tracker.observation import Observation
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.warm_up import warm_up

COMPREHENSIONS = ("<listcomp>", "<genexpr>", "<dictcomp>", "<setcomp>")


def profile(tracker: MultiTargetTracker, image: np.ndarray, observation: Observation) -> tuple[int, int]:
    """Named functions of the tracker that one step calls, and how deep they call each other."""
    functions: set[CodeType] = set()
    depth = deepest = 0

    def count(frame: FrameType, event: str, _: object) -> None:
        nonlocal depth, deepest
        code = frame.f_code
        if "streamkit_tracker" not in code.co_filename or code.co_name.endswith(COMPREHENSIONS):
            return
        if event == "call":
            depth += 1
            deepest = max(deepest, depth)
            functions.add(code)
        elif event == "return":
            depth -= 1

    sys.setprofile(count)
    try:
        tracker.step(image, observation)
    finally:
        sys.setprofile(None)
    return len(functions), deepest


def test_a_frame_passes_through_few_functions(scenes: ModuleType):
    """With detected targets: at most 70 functions on average, and at most 8 deep."""
    warm_up()
    generator = np.random.default_rng(3)
    starts = [(100.0, 120.0), (300.0, 100.0), (200.0, 250.0)]
    cars = [scenes.Car(start, (50.0, 20.0), scenes.car_texture(generator)) for start in starts]
    tracker, counts, depths = MultiTargetTracker(), [], []
    for seen in scenes.Flight(cars, frames=40, seed=3):
        observation = Observation(
            0.04,
            to_previous=seen.to_previous,
            to_reference=seen.to_reference,
            centroids=seen.centroids,
            boxes=seen.boxes,
        )
        functions, depth = profile(tracker, seen.image, observation)
        counts.append(functions)
        depths.append(depth)
    assert np.mean(counts[10:]) <= 70
    assert max(depths[10:]) <= 8  # the first frames also pass through the loader of compiled code


def test_a_pipeline_imports_neither_evaluation_nor_explanation():
    """The element, once started, has imported no module of the commands."""
    script = (
        "import sys; from streamkit.testing import Harness\n"
        "with Harness('particletrack'): pass\n"
        "print([name for name in sys.modules if 'streamkit_tracker.e' in name])"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=80, check=True
    )
    assert done.stdout.strip() == "['streamkit_tracker.element']"
