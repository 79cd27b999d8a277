"""Background adjustment of keyframes: loop closure, then bundle adjustment."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from functools import partial
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, inverse, scale_change
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings, adjust
from streamkit_stitcher.bundle_adjustment.problem import PlaneProblem
from streamkit_stitcher.plane.keyframe_content import TIMEOUT_S, executor_for
from streamkit_stitcher.plane.keyframe_graph import Tie

_LARGEST_SCALE: Final = 50.0


# Homographies of the adjusted keyframes to the plane, and the ties found to earlier keyframes.
Adjusted = tuple[Mapping[int, FloatArray], Sequence[Tie]]
NOTHING: Final[Adjusted] = ({}, ())


def adjust_homographies(
    problem: PlaneProblem, indices: Sequence[int], settings: AdjustmentSettings
) -> tuple[dict[int, FloatArray], float]:
    """Solves a problem; degenerate results are left out.

    Returns:
        Homographies of the free keyframes, and the root mean square residual in px.
    """
    result = adjust(problem, settings)
    homographies = {}
    for camera, index in enumerate(indices):
        matrix = inverse(result.cameras[camera])
        if not problem.fixed[camera] and 0 < scale_change(matrix, (720, 1280)) < _LARGEST_SCALE:
            homographies[index] = matrix
    return homographies, result.rmse


class BackgroundAdjuster:
    """Runs one job at a time in a thread.

    The stream takes a result at a moment of its own choice and waits for it there, so that the same frames
    give the same homographies however the threads run.
    """

    def __init__(self) -> None:
        self._executor: BackgroundExecutor = executor_for("adjuster")
        self._pending: Future[Adjusted] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether a job was submitted whose result was not taken."""
        return self._pending is not None

    def submit(
        self,
        found: tuple[PlaneProblem, tuple[int, ...]] | None,
        settings: AdjustmentSettings,
        close_loops: Callable[[], Sequence[Tie]],
    ) -> None:
        """Begins a job; the result of the previous one must have been taken.

        Args:
            found: the problem and the keyframe of each of its cameras, or None where nothing can move.
            settings: of the adjustment.
            close_loops: returns the ties of the new keyframe.
        """
        self._pending = self._executor.submit(partial(self._run, found, settings, close_loops))

    def take(self) -> Adjusted:
        """Waits for the job's result; empty where there is none, it fails, or it takes longer than 20 s."""
        pending, self._pending = self._pending, None
        if pending is None:
            return NOTHING
        try:
            return pending.result(timeout=TIMEOUT_S)
        except (TimeoutError, np.linalg.LinAlgError):
            return NOTHING

    def close(self) -> None:
        """Ends the thread after the running job."""
        self._pending = None
        self._executor.close(TIMEOUT_S)

    def _run(
        self,
        found: tuple[PlaneProblem, tuple[int, ...]] | None,
        settings: AdjustmentSettings,
        close_loops: Callable[[], Sequence[Tie]],
    ) -> Adjusted:
        ties = close_loops()
        return ({} if found is None else adjust_homographies(*found, settings)[0]), ties
