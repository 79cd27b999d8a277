"""The keyframes of one plane: their homographies, ties and adjustment."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from streamkit.geometry.homography import IDENTITY, FloatArray, GreyArray, inverse, normalised
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings
from streamkit_stitcher.plane.adjuster import BackgroundAdjuster, adjust_homographies
from streamkit_stitcher.plane.closure_check import FEW_STEPS, ClosureCheck
from streamkit_stitcher.plane.keyframe_content import (
    LEVELS,
    TIMEOUT_S,
    deferred,
    executor_for,
    keyframe_content,
)
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie
from streamkit_stitcher.plane.keyframes import Keyframe, KeyframeMatch, KeyframeStore
from streamkit_stitcher.plane.settings import ModelChoice, PlaneSettings
from streamkit_stitcher.registration.descriptors import Description
from streamkit_stitcher.registration.model_selection import ModelSelection, MotionRule
from streamkit_stitcher.registration.motion_models import MotionModel
from streamkit_stitcher.registration.patches import pyramid

_LOOP_OVERLAP: Final = 0.12
_LOOP_CANDIDATES: Final = 3
_WHOLE_LIMIT: Final = 60
_FINAL_ITERATIONS: Final = 30
_MAX_HOMOGRAPHIES: Final = 20_000


class KeyframeMap:
    """Keeps the keyframes of a plane at consistent homographies.

    Args:
        settings: the tracker's settings.

    Attributes:
        executor: computes in the background what the next frame needs of a keyframe.
        active: the keyframe that frames are measured against.
    """

    def __init__(self, settings: PlaneSettings) -> None:
        self._settings = settings
        self._store = KeyframeStore(settings.max_keyframes)
        self._graph = KeyframeGraph(settings.max_adjusted)
        self._adjuster = BackgroundAdjuster()
        self._closures = ClosureCheck()
        self._selection = ModelSelection()
        self._reference = 0
        self._loop_closed = False
        self.executor = executor_for("keyframes")
        self.active: Keyframe | None = None

    def __len__(self) -> int:
        return len(self._graph)

    @property
    def stored(self) -> tuple[Keyframe, ...]:
        """The keyframes that frames can still be matched with, oldest first."""
        return self._store.keyframes

    @property
    def homographies(self) -> Mapping[int, FloatArray]:
        """float64[3, 3] of the newest 20 000 and all stored keyframes, pixels to the reference plane."""
        return self._graph.homographies

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
        return self._adjuster.is_busy

    def tied_to(self, index: int) -> set[int]:
        """The earlier keyframes that a keyframe shares tie points with."""
        return self._graph.hosts(index)

    def overlapping(
        self, to_reference: FloatArray, shape: tuple[int, int], least: float
    ) -> list[tuple[float, Keyframe]]:
        """The stored keyframes that overlap a frame, see `KeyframeStore.overlapping`."""
        return self._store.overlapping(to_reference, shape, least)

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
        shape = (images[0].shape[0], images[0].shape[1])
        # Copies: the buffer behind the frame may be reused.
        own = tuple(image.copy() for image in images[: level + 1])
        content = deferred(self.executor, keyframe_content, own, level)
        self.active = self._store.add(content, to_reference, shape, level, corner_std)
        index = self.active.index
        self._graph.add(index, to_reference, [replace(tie, observer=index) for tie in ties])
        self._graph.forget(
            _MAX_HOMOGRAPHIES, {*(keyframe.index for keyframe in self.stored), self._reference}
        )
        return self.active

    def begin_adjustment(
        self, images: Sequence[GreyArray], description: Description | None = None, whole: bool = False
    ) -> None:
        """Begins adjusting the newest keyframes; the previous result must have been adopted.

        Args:
            images: the newest keyframe.
            description: its features, if they were computed before.
            whole: whether up to 60 keyframes are adjusted, as after a loop closure.
        """
        if self.active is None or self._settings.window <= 0:
            return
        candidates = self._loop_candidates(self.active)
        tried = {self.active.index, *self._graph.hosts(self.active.index), *(one.index for one in candidates)}
        others = () if description is None else tuple(one for one in self.stored if one.index not in tried)
        tied = self._graph.tied
        free = tied[-_WHOLE_LIMIT:] if whole or self._loop_closed else tied[-self._settings.window :]
        steps = self._graph.steps_from(self.active.index) if candidates or others else {}
        near = frozenset(index for index, count in steps.items() if count <= FEW_STEPS)
        found = self._graph.problem(free, self._reference)
        self._loop_closed = False
        if found is None and not candidates and not others:
            return
        # Copies: the buffer behind the frame may be reused.
        own = pyramid(tuple(image.copy() for image in images), LEVELS) if candidates or others else ()
        keyframe = self.active
        self._adjuster.submit(
            found,
            self._adjustment(),
            lambda closer: closer.close(keyframe, own, candidates, near, description, others),
        )

    def adopt(self) -> FloatArray | None:
        """Waits for the adjustment; returns the change of the plane under the active keyframe, or None."""
        homographies, found = self._adjuster.take()
        ties = self._accepted_ties(found)
        for tie in ties:
            self._graph.tie(tie)
        self._loop_closed = self._loop_closed or (bool(ties) and self._closures.is_far)
        return self._move(homographies)

    def rebase(self, reference: int) -> FloatArray:
        """Makes a keyframe's plane the reference; returns the homography from the old plane to the new."""
        change = inverse(self._graph.homographies.get(reference, IDENTITY))
        self._graph.rebase(change)
        self._reference = reference
        self._refresh()
        return change

    def level(self, change: FloatArray) -> None:
        """Moves all keyframes to another plane, old to new, whose reference is no keyframe's."""
        self._graph.rebase(change)
        self._refresh()

    def finish(self) -> float:
        """Adjusts all tied keyframes; returns the root mean square residual of the ties, px."""
        self.adopt()
        found = self._graph.problem(self._graph.tied, self._reference)
        if found is None:
            return 0.0
        settings = replace(self._adjustment(), ba_iterations=_FINAL_ITERATIONS)
        homographies, rmse = adjust_homographies(*found, settings)
        self._move(homographies)
        return rmse

    def retire(self) -> None:
        """Releases the patches and features that only new frames need; `finish` still works."""
        self._store, self.active = KeyframeStore(0), None
        self._adjuster.forget_features()

    def close(self) -> None:
        """Ends the threads; `executor` last, as a running job may wait for it."""
        self._adjuster.close()
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

    def _accepted_ties(self, ties: Sequence[Tie]) -> tuple[Tie, ...]:
        if not ties or self.active is None:
            return ()
        steps = self._graph.steps_from(ties[0].observer)
        return self._closures.accepted(ties, self._graph.homographies, steps, self.active.shape)

    def _move(self, homographies: Mapping[int, FloatArray]) -> FloatArray | None:
        if not homographies:
            return None
        before = self.active
        self._graph.move(homographies)
        self._refresh()
        if before is None or self.active is None or before.index not in homographies:
            return None
        return normalised(self.active.to_reference @ inverse(before.to_reference))

    def _refresh(self) -> None:
        """Copies the graph's homographies to the stored keyframes."""
        self._store.move(self._graph.homographies)
        if self.active is not None:
            matrix = self._graph.homographies.get(self.active.index, IDENTITY)
            self.active = replace(self.active, to_reference=matrix)
