"""What is compiled before the first frame."""

import sys
from types import ModuleType

import numpy as np
from numba.core.dispatcher import Dispatcher

from streamkit_tracker.observation import Observation
from streamkit_tracker.tracker import MultiTargetTracker
from streamkit_tracker.warm_up import warm_up


def compiled_kinds() -> dict[str, int]:
    """Every compiled loop of the tracker, with the number of kinds of arguments it was compiled for."""
    return {
        f"{name}.{label}": len(value.signatures)
        for name, module in sys.modules.items()
        if name.startswith("streamkit_tracker.")
        for label, value in vars(module).items()
        if isinstance(value, Dispatcher) and value.py_func.__module__ == name
    }


def test_no_frame_waits_for_the_compiler(scenes: ModuleType):
    """Targets drawn and detected, alone and together, call for nothing that was not compiled before."""
    warm_up()
    before = compiled_kinds()
    tracker = MultiTargetTracker()
    for index, (image, truth) in enumerate(scenes.TurningScene(seed=2, frames=16)):
        image.flags.writeable = False
        if index == 0:
            tracker.start_target(image, truth, Observation(0.04))
        places = np.array([[100.0 + 4 * index, 100], [200 + 4 * index, 100]])
        half = np.array([12.0, 6])
        boxes = np.hstack([places - half, places + half])
        homography = np.eye(3)
        homography.flags.writeable = False
        tracker.step(image, Observation(0.04, to_previous=homography, centroids=places, boxes=boxes))
    assert compiled_kinds() == before
    assert sum(before.values()) > 5  # those within others count only where they are compiled anew
