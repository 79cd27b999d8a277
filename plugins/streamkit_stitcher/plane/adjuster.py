"""Adjusting the key pictures beside the stream: loops are closed, places made to agree."""

from collections.abc import Collection, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass
from typing import Final

import numpy as np

from streamkit.geometry.homography import FloatArray, GreyArray, inverse, scale_change
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings, adjust
from streamkit_stitcher.bundle_adjustment.problem import PlaneProblem
from streamkit_stitcher.plane.graph import Tie
from streamkit_stitcher.plane.keyframes import Keyframe
from streamkit_stitcher.plane.loop_closure import LoopCloser
from streamkit_stitcher.registration.descriptors import Description

_TIMEOUT_S: Final = 20.0
_LARGEST_SCALE: Final = 50.0


@dataclass(frozen=True, eq=False)
class AdjustmentJob:
    """What is to be done beside the stream for one new key picture.

    Attributes:
        problem: the adjustment, or None where nothing can move.
        indices: the key picture of each of its cameras.
        settings: how it runs.
        keyframe: the new key picture.
        images: its picture and halvings, not changed by anybody.
        candidates: key pictures that may show the same ground, without a tie to it.
        near: key pictures whose place to the new one is known to a few px.
        description: what the new key picture is recognised by, if that was worked out before.
    """

    problem: PlaneProblem | None
    indices: tuple[int, ...]
    settings: AdjustmentSettings
    keyframe: Keyframe
    images: Sequence[GreyArray]
    candidates: Sequence[Keyframe]
    near: Collection[int] = ()
    description: Description | None = None


@dataclass(frozen=True, eq=False)
class Adjusted:
    """What came of it.

    Attributes:
        places: float64[3, 3] of each key picture that was adjusted, its pixels to the plane.
        ties: ties found to earlier key pictures.
        rmse: root mean square residual of the tie points, px.
        iterations: steps of the adjustment.
    """

    places: Mapping[int, FloatArray]
    ties: Sequence[Tie]
    rmse: float
    iterations: int


NOTHING: Final = Adjusted({}, (), 0.0, 0)


def adjusted_places(
    problem: PlaneProblem, indices: Sequence[int], settings: AdjustmentSettings
) -> tuple[dict[int, FloatArray], float, int]:
    """Adjusts a problem; places that came out degenerate keep what they were.

    Returns:
        Places of the free key pictures, the residuals' root mean square in px, and the steps taken.
    """
    result = adjust(problem, settings)
    shape = (720, 1280)
    places = {}
    for camera, index in enumerate(indices):
        place = inverse(result.cameras[camera])
        if not problem.fixed[camera] and 0 < scale_change(place, shape) < _LARGEST_SCALE:
            places[index] = place
    return places, result.rmse, result.iterations


class Adjuster:
    """One worker that adjusts, and at most one job for it at a time.

    The stream takes a job's result at a moment of its own choosing and waits for it there, so that the same
    pictures give the same places however the threads run.
    """

    def __init__(self) -> None:
        self._executor: ThreadPoolExecutor | None = None
        self._pending: Future[Adjusted] | None = None
        self._closer = LoopCloser()

    @property
    def is_busy(self) -> bool:
        """Whether a job was given whose result was not taken."""
        return self._pending is not None

    def submit(self, job: AdjustmentJob) -> None:
        """Begins a job; the result of the one before must have been taken."""
        if self._executor is None:
            self._executor = ThreadPoolExecutor(max_workers=1, thread_name_prefix="adjuster")
        self._pending = self._executor.submit(self._work, job)

    def take(self) -> Adjusted:
        """Waits for the job's result; nothing where there is none or it takes longer than 20 s."""
        pending, self._pending = self._pending, None
        if pending is None:
            return NOTHING
        try:
            return pending.result(timeout=_TIMEOUT_S)
        except (FutureTimeout, np.linalg.LinAlgError):
            return NOTHING

    def retire(self) -> None:
        """Ends the worker after the job at hand, which nobody waits for here; `take` and `close` still do."""
        self._closer = LoopCloser()
        if self._executor is not None:
            self._executor.shutdown(wait=False)

    def close(self) -> None:
        """Ends the worker, after the job at hand."""
        executor, self._executor, self._pending = self._executor, None, None
        if executor is not None:
            executor.shutdown(wait=True, cancel_futures=True)

    def _work(self, job: AdjustmentJob) -> Adjusted:
        ties = self._closer.close(job.keyframe, job.images, job.candidates, job.near, job.description)
        if job.problem is None:
            return Adjusted({}, ties, 0.0, 0)
        places, rmse, iterations = adjusted_places(job.problem, job.indices, job.settings)
        return Adjusted(places, ties, rmse, iterations)
