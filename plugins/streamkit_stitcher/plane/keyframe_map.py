"""The keyframes of a stream's planes: their homographies, ties and adjustment."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from streamkit.geometry.homography import (
    IDENTITY,
    FloatArray,
    GreyArray,
    centre,
    inverse,
    normalised,
)
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings
from streamkit_stitcher.bundle_adjustment.lens import Lens
from streamkit_stitcher.bundle_adjustment.problem import PlaneProblem
from streamkit_stitcher.plane.closure_check import FEW_STEPS, accepted_ties
from streamkit_stitcher.plane.keyframe_content import (
    LEVELS,
    TIMEOUT_S,
    deferred,
    executor_for,
    keyframe_content,
)
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie, adjusted_homographies
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch, KeyframeStore
from streamkit_stitcher.plane.loop_closure import LoopCloser
from streamkit_stitcher.plane.plane_joining import joins
from streamkit_stitcher.plane.relocaliser import Relocaliser
from streamkit_stitcher.plane.settings import ModelChoice, PlaneSettings
from streamkit_stitcher.registration.descriptors import FrameFeatures
from streamkit_stitcher.registration.model_selection import ModelSelection, MotionRule
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.patches import pyramid

_LOOP_OVERLAP: Final = 0.12
_LOOP_CANDIDATES: Final = 3
_WHOLE_LIMIT: Final = 60
_FINAL_ITERATIONS: Final = 30
_MAX_HOMOGRAPHIES: Final = 20_000
# Homographies of the adjusted keyframes to the plane, and the ties found to earlier keyframes.
_Adjusted = tuple[Mapping[int, FloatArray], Sequence[Tie]]
_NOTHING: Final[_Adjusted] = ({}, ())


class KeyframeMap:
    """Keeps the keyframes of each plane at consistent homographies, and joins planes that meet.

    Args:
        settings: the tracker's settings.
        plane: number of the first plane.

    Attributes:
        executor: computes in the background what the next frame needs of a keyframe.
        active: the keyframe that frames are measured against; None at the start of a plane.
        relocaliser: matches frames with keyframes by features.
    """

    def __init__(self, settings: PlaneSettings, plane: int = 0) -> None:
        self._settings = settings
        self._store = KeyframeStore(settings.max_keyframes)
        self._graph = KeyframeGraph(settings.max_adjusted)
        self.relocaliser = Relocaliser()
        self._closer = LoopCloser(self.relocaliser)
        self._adjuster = executor_for("adjuster")
        self._pending: Future[_Adjusted] | None = None
        self._selection = ModelSelection()
        self._plane = plane
        self._references: dict[int, int] = {}
        self._shape = 0, 0
        self._loop_closed = False
        self.executor = executor_for("keyframes")
        self.active: Keyframe | None = None

    def __len__(self) -> int:
        """Number of keyframes ever added to the current plane."""
        return self._graph.added(self.plane)

    @property
    def plane(self) -> int:
        """Number of the current plane, that of the active keyframe."""
        return self._plane if self.active is None else self.active.plane

    @property
    def stored(self) -> tuple[Keyframe, ...]:
        """The keyframes of all planes that frames can still be matched with, oldest first."""
        return self._store.keyframes

    @property
    def homographies(self) -> Mapping[int, FloatArray]:
        """float64[3, 3] of the newest 20 000 and all stored keyframes, pixels to their planes."""
        return self._graph.homographies

    @property
    def planes(self) -> Mapping[int, Mapping[int, FloatArray]]:
        """The homographies of the keyframes of each plane, by its number."""
        found: dict[int, dict[int, FloatArray]] = {}
        for index, matrix in self._graph.homographies.items():
            found.setdefault(self._graph.planes[index], {})[index] = matrix
        return found

    def begin_plane(self, number: int) -> None:
        """Ends the current plane, which stays to be met again; the next keyframe is the first of another."""
        self.adopt()
        self._plane, self.active = number, None

    @property
    def model(self) -> MotionModel:
        """The motion model as selected or set."""
        if self._settings.model is ModelChoice.AUTO:
            return self._selection.model
        return MotionModel(self._settings.model.value)

    @property
    def rule(self) -> MotionRule:
        """The motion model of a frame; `auto` allows single frames to differ."""
        return MotionRule(self.model, strict=self._settings.model is not ModelChoice.AUTO)

    @property
    def is_adjusting(self) -> bool:
        """Whether an adjustment was begun whose result was not adopted."""
        return self._pending is not None

    def tied_to(self, index: int) -> set[int]:
        """The earlier keyframes that a keyframe shares tie points with."""
        return self._graph.hosts(index)

    def overlapping(
        self, to_reference: FloatArray, shape: tuple[int, int], least: float
    ) -> list[tuple[float, Keyframe]]:
        """The stored keyframes of the current plane that overlap a frame, see `KeyframeStore.overlapping`."""
        return self._store.overlapping(to_reference, shape, least, self.plane)

    def current(self, keyframe: Keyframe) -> Keyframe:
        """A keyframe with its present homography."""
        matrix = self._graph.homographies.get(keyframe.index, keyframe.to_reference)
        return replace(keyframe, to_reference=matrix)

    def learn(self, match: KeyframeMatch) -> None:
        """Adds the match of two keyframes to the selection of the motion model."""
        inliers = match.on_plane()
        self._selection.add(inliers.frame_points, inliers.key_points)

    def add(
        self,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        level: int,
        ties: Sequence[Tie],
        corner_std: float = 0.0,
    ) -> Keyframe:
        """Makes a frame a keyframe, and the active one; the ties may name any observer."""
        self._shape = shape = images[0].shape[0], images[0].shape[1]
        # Copies: the buffer behind the frame may be reused.
        own = tuple(image.copy() for image in images[: level + 1])
        content = deferred(self.executor, keyframe_content, own, level)
        plane = self.plane
        self.active = self._store.add(content, to_reference, shape, level, corner_std, plane)
        index = self.active.index
        self._references.setdefault(plane, index)
        self._graph.add(index, to_reference, [replace(tie, observer=index) for tie in ties], plane)
        needed = {keyframe.index for keyframe in self.stored}
        self._graph.forget(_MAX_HOMOGRAPHIES, needed.union(self._references.values()))
        return self.active

    def begin_adjustment(
        self,
        images: Sequence[GreyArray],
        description: FrameFeatures | None = None,
        whole: bool = False,
        is_sparse: bool = False,
    ) -> None:
        """Begins adjusting the newest keyframes; the previous result must have been adopted.

        Args:
            images: the newest keyframe.
            description: its features, if they were computed before.
            whole: whether up to 60 keyframes are adjusted, as after a loop closure.
            is_sparse: whether frames are far apart, so that patches of leaning trees and houses do not match.
        """
        if self.active is None or self._settings.window <= 0:
            return
        candidates = self._loop_candidates(self.active)
        tried = {self.active.index, *self._graph.hosts(self.active.index), *(one.index for one in candidates)}
        others = tuple(
            one
            for one in self.stored
            if one.index not in tried and (description is not None or one.plane != self.plane)
        )
        tied = [index for index in self._graph.tied if self._graph.planes[index] == self.plane]
        free = tied[-_WHOLE_LIMIT:] if whole or self._loop_closed else tied[-self._settings.window :]
        steps = self._graph.steps_from(self.active.index) if candidates or others else {}
        near = frozenset(index for index, count in steps.items() if count <= FEW_STEPS and not is_sparse)
        found = self._graph.problem(free, self._references.values())
        self._loop_closed = False
        if found is None and not candidates and not others:
            return
        # Copies: the buffer behind the frame may be reused.
        own = pyramid(tuple(image.copy() for image in images), LEVELS) if candidates or others else ()
        keyframe = self.active
        close_loops = partial(self._closer.close, keyframe, own, candidates, near, description, others)
        self._pending = self._adjuster.submit(partial(_adjusted, found, self._adjustment(), close_loops))

    def adopt(self) -> FloatArray | None:
        """Waits for the adjustment; returns the change of the plane under the active keyframe, or None.

        The stream adopts it at a moment of its own choice and waits for it there, so that the same frames
        give the same homographies however the threads run. One that fails or takes 20 s changes nothing.
        """
        before, pending, self._pending = self.active, self._pending, None
        homographies, found = _NOTHING
        if pending is not None:
            with suppress(TimeoutError, np.linalg.LinAlgError):
                homographies, found = pending.result(timeout=TIMEOUT_S)
        planes = self._graph.planes
        across = [tie for tie in found if planes.get(tie.host) != planes.get(tie.observer)]
        inside = [tie for tie in found if tie not in across]
        steps = self._graph.steps_from(inside[0].observer) if inside else {}
        ties, is_far = accepted_ties(inside, self._graph.homographies, steps, self._shape)
        for tie in ties:
            self._graph.tie(tie)
        self._loop_closed = self._loop_closed or is_far
        self._graph.move(homographies)
        for change, moved, kept in joins(across, self._graph, self.plane, self._shape):
            self._graph.rebase(change, moved, kept)
            self._references.pop(moved, None)
            self._loop_closed = True
        self._refresh()
        if before is None or self.active is None:
            return None
        step = normalised(self.active.to_reference @ inverse(before.to_reference))
        return None if np.array_equal(self.active.to_reference, before.to_reference) else step

    def rebase(self, reference: int, number: int) -> FloatArray:
        """Makes the current plane that of a keyframe, and its number `number`.

        Returns:
            The homography from the old plane to the new.
        """
        change, old = inverse(self._graph.homographies.get(reference, IDENTITY)), self.plane
        self._graph.rebase(change, old, number)
        self._references.pop(old, None)
        self._references[number] = reference
        self._plane = number
        self._refresh()
        return change

    def reference_of(self, number: int) -> int | None:
        """The keyframe number `number` of the current plane, counted from 0."""
        own = [index for index, plane in self._graph.planes.items() if plane == self.plane]
        return own[number] if number < len(own) else None

    def finish(self, focal_px: float = 0.0) -> float:
        """Adjusts all tied keyframes; returns the root mean square residual of the ties, px.

        With the focal length of all frames the plane becomes level: no keyframe is its reference.
        """
        self.adopt()
        found = self._graph.problem(self._graph.tied, self._references.values())
        if found is None:
            return 0.0
        settings = replace(self._adjustment(), ba_iterations=_FINAL_ITERATIONS)
        problem, indices = found
        if focal_px > 0:
            lens = Lens(focal_px, centre(self._shape))
            problem = replace(problem, fixed=np.zeros_like(problem.fixed), lens=lens)
            settings = replace(settings, model=MotionModel.HOMOGRAPHY)
        homographies, rmse = adjusted_homographies(problem, indices, settings)
        self._graph.move(homographies)
        self._refresh()
        return rmse

    def retire(self) -> None:
        """Releases the patches and features that only new frames need; `finish` still works."""
        self.adopt()
        self._plane = self.plane
        self._store, self.active = KeyframeStore(0), None
        self.relocaliser.forget()

    def close(self) -> None:
        """Ends the threads; `executor` last, as a running job may wait for it."""
        self._pending = None
        self._adjuster.close(TIMEOUT_S)
        self.executor.close(TIMEOUT_S)

    def _adjustment(self) -> AdjustmentSettings:
        return replace(self._settings.adjustment, model=self.model)

    def _loop_candidates(self, keyframe: Keyframe) -> tuple[Keyframe, ...]:
        """Keyframes that overlap the newest but have no tie to it."""
        tied = self._graph.hosts(keyframe.index)
        return tuple(
            other
            for _, other in self.overlapping(keyframe.to_reference, keyframe.shape, _LOOP_OVERLAP)
            if other.index < keyframe.index - 2 and other.index not in tied
        )[:_LOOP_CANDIDATES]

    def _refresh(self) -> None:
        """Copies the graph's homographies to the stored keyframes."""
        graph = self._graph
        self._store.move(graph.homographies, graph.planes)
        if self.active is not None:
            index = self.active.index
            plane = graph.planes.get(index, self.active.plane)
            self.active = replace(
                self.active, to_reference=graph.homographies.get(index, IDENTITY), plane=plane
            )


def _adjusted(
    found: tuple[PlaneProblem, tuple[int, ...]] | None,
    settings: AdjustmentSettings,
    close_loops: Callable[[], Sequence[Tie]],
) -> _Adjusted:
    """The ties of the newest keyframe, and the adjustment of those before it."""
    ties = close_loops()
    return ({} if found is None else adjusted_homographies(*found, settings)[0]), ties
