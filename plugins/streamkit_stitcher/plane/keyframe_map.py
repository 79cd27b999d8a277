"""The keyframes of a stream's planes: their homographies, ties and adjustment."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from streamkit.geometry.homography import IDENTITY, FloatArray, GreyArray, centre, inverse, normalised
from streamkit.handoff.background_executor import BackgroundExecutor
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings
from streamkit_stitcher.bundle_adjustment.lens import Lens
from streamkit_stitcher.plane.keyframe_content import keyframe_content
from streamkit_stitcher.plane.keyframe_graph import KeyframeGraph, Tie, adjusted_homographies
from streamkit_stitcher.plane.keyframes import (
    Keyframe,
    KeyframeMatch,
    most_overlapping,
    most_redundant,
)
from streamkit_stitcher.plane.loop_closure import close_loops
from streamkit_stitcher.plane.patch_matching import PatchMatcher
from streamkit_stitcher.plane.plane_joining import PlaneTies
from streamkit_stitcher.plane.settings import ModelChoice, PlaneSettings
from streamkit_stitcher.plane.tie_checks import accepted_ties
from streamkit_stitcher.registration.descriptors import FrameFeatures
from streamkit_stitcher.registration.model_selection import ModelSelection, MotionRule
from streamkit_stitcher.registration.motion_models import MotionModel

_TIMEOUT_S: Final = 20.0
_LOOP_OVERLAP: Final = 0.12
_LOOP_CANDIDATES: Final = 3
_WHOLE_LIMIT: Final = 60
# Keyframes of a video overlap by two thirds, so that every third shows all of the ground: one in so many is
# searched by features, which takes as long as a hundred frames.
_SEARCH_PERIOD: Final = 3
_FINAL_ITERATIONS: Final = 30
_MAX_HOMOGRAPHIES: Final = 20_000
# Homographies of the adjusted keyframes to the plane, and the ties found to earlier keyframes.
_Adjusted = tuple[Mapping[int, FloatArray], Sequence[Tie]]


class KeyframeMap:
    """Keeps the keyframes of each plane at consistent homographies, and joins planes that meet.

    Those of the most recent `max_keyframes` that cover the ground best are stored, to match frames with.

    Args:
        settings: of the registration.
        plane: number of the first plane.

    Attributes:
        plane: number of the current plane.
        rule: the motion model of a frame, as selected or set; `auto` allows single frames to differ.
    """

    def __init__(self, settings: PlaneSettings, plane: int = 0) -> None:
        self._settings = settings
        self._stored: dict[int, Keyframe] = {}
        self._graph = KeyframeGraph(settings.max_adjusted)
        self._selection = ModelSelection()
        is_auto = settings.model is ModelChoice.AUTO
        model = MotionModel.HOMOGRAPHY if is_auto else MotionModel(settings.model.value)
        self.rule = MotionRule(model, strict=not is_auto)
        self._references: dict[int, int] = {}
        self._count = self._active = 0
        self._shape = 0, 0
        self._newest: tuple[GreyArray, ...] = ()  # the newest keyframe and its halvings
        self._loop_closed = self._is_survey = False
        self._pending: Future[_Adjusted] | None = None
        # The stream asks for all results that it needs, so that no failure goes unseen.
        self._adjuster, self._executor = (
            BackgroundExecutor(name, failed=lambda _: None) for name in ("adjuster", "keyframes")
        )
        self._matcher = PatchMatcher()
        self._plane_ties = PlaneTies()
        self.plane = plane

    def __len__(self) -> int:
        """Number of keyframes ever added to the current plane."""
        return self._graph.added[self.plane]

    @property
    def active(self) -> Keyframe:
        """The keyframe of the current plane that frames are measured against."""
        return self._stored[self._active]

    @property
    def stored(self) -> tuple[Keyframe, ...]:
        """The keyframes of all planes that frames can still be matched with, oldest first."""
        return tuple(self._stored.values())

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

    def tied_to(self, index: int) -> set[int]:
        """The earlier keyframes that a keyframe shares tie points with."""
        return self._graph.hosts(index)

    def overlapping(
        self, to_reference: FloatArray, shape: tuple[int, int], min_overlap: float
    ) -> list[Keyframe]:
        """The stored keyframes of the current plane that overlap a frame at a similar scale, most first."""
        own = [one for one in self._stored.values() if one.plane == self.plane]
        return most_overlapping(own, to_reference, shape, min_overlap)

    def learn(self, match: KeyframeMatch) -> None:
        """Adds the match of two keyframes to the selection of the motion model."""
        if not self.rule.strict:
            inliers = match.on_plane()
            self._selection.add(inliers.frame_points, inliers.key_points)
            self.rule = MotionRule(self._selection.model, strict=False)

    def activate(self, keyframe: Keyframe) -> None:
        """Makes a stored keyframe the active one, and its plane the current one."""
        self._active, self.plane = keyframe.index, keyframe.plane

    def add(
        self,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        level: int,
        ties: Sequence[Tie],
        corner_std: float = 0.0,
        features: FrameFeatures | None = None,
        is_video: bool = False,
    ) -> Keyframe:
        """Makes a frame a keyframe of the current plane, and the active one; ties may name any observer.

        `features` are those of the frame, if they were computed before; those of a video are found faster.
        """
        self._shape = shape = images[0].shape[0], images[0].shape[1]
        # A copy: the buffer behind the frame may be reused, those of its halvings are not.
        self._newest = (images[0].copy(), *images[1:])
        # Waiting for results, not polling, gives the same homographies however the threads run.
        content = self._executor.submit(partial(keyframe_content, self._newest, level, features, is_video))
        # A search may need those of many keyframes at once.
        self._executor.submit(lambda: content.result().features)
        index, self._count = self._count, self._count + 1
        keyframe = Keyframe(
            index,
            to_reference,
            shape,
            2**level,
            partial(content.result, _TIMEOUT_S),
            corner_std,
            self.plane,
        )
        self._stored[index] = keyframe
        self.activate(keyframe)
        if len(self._stored) > self._settings.max_keyframes:
            stored = self.stored
            del self._stored[stored[most_redundant(stored)].index]
        self._references.setdefault(self.plane, index)
        self._graph.add(index, to_reference, [replace(tie, observer=index) for tie in ties], self.plane)
        self._graph.forget(_MAX_HOMOGRAPHIES, {*self._stored, *self._references.values()})
        return keyframe

    def begin_adjustment(
        self, relocalised: bool = False, whole: bool = False, is_survey: bool = False
    ) -> None:
        """Begins adjusting the newest keyframes; the previous result must have been adopted.

        Args:
            relocalised: whether the newest was matched by features, so that it may lie anywhere.
            whole: whether up to 60 keyframes are adjusted, as after a loop closure.
            is_survey: whether the newest is a photograph: these are far apart, so that patches of leaning
                trees and houses do not match.
        """
        if self._settings.window <= 0:
            return
        keyframe, tied = self.active, self._graph.hosts(self._active)
        overlapping = self.overlapping(keyframe.to_reference, keyframe.shape, _LOOP_OVERLAP)
        # Those that overlap the newest, but have no tie to it.
        candidates = [one for one in overlapping if one.index < keyframe.index - 2 and one.index not in tied]
        candidates = candidates[:_LOOP_CANDIDATES]
        if not is_survey:
            seen = self._plane_ties.seen_from(self.plane, self._stored.values(), self._graph)
            candidates += most_overlapping(seen, keyframe.to_reference, keyframe.shape, _LOOP_OVERLAP)[
                :_LOOP_CANDIDATES
            ]
        tried = {keyframe.index, *tied, *(one.index for one in candidates)}
        period = 1 if relocalised or is_survey else _SEARCH_PERIOD
        is_searched = keyframe.index % period == 0
        others = [
            one
            for one in self.stored
            if is_searched
            and one.index % period == 0
            and one.index not in tried
            and (relocalised or one.plane != self.plane)
        ]
        movable = [index for index in self._graph.tied if self._graph.planes[index] == self.plane]
        free = movable[-(_WHOLE_LIMIT if whole or self._loop_closed else self._settings.window) :]
        problem = self._graph.problem(free, self._references.values())
        self._loop_closed, self._is_survey = False, is_survey
        if problem is None and not candidates and not others:
            return
        newest, settings = self._newest, self._adjustment()

        def adjusted() -> _Adjusted:
            ties = close_loops(self._matcher, keyframe, newest, candidates, others, is_searched)
            return ({} if problem is None else adjusted_homographies(problem, settings)[0]), ties

        self._pending = self._adjuster.submit(adjusted)

    def adopt(self) -> FloatArray | None:
        """Waits for the adjustment; returns the change of the plane under the active keyframe, or None.

        The stream adopts it at a moment of its own choice and waits for it there, so that the same frames
        give the same homographies however the threads run. One that fails or takes 20 s changes nothing.
        """
        pending, self._pending = self._pending, None
        if pending is None:
            return None
        before = self.active.to_reference
        homographies: Mapping[int, FloatArray] = {}
        found: Sequence[Tie] = ()
        with suppress(TimeoutError, np.linalg.LinAlgError):
            homographies, found = pending.result(timeout=_TIMEOUT_S)
        planes = self._graph.planes
        across = [tie for tie in found if planes.get(tie.host) != planes.get(tie.observer)]
        inside = [tie for tie in found if tie not in across]
        steps = self._graph.steps_from(inside[0].observer) if inside else {}
        ties, is_far = accepted_ties(inside, self._graph.homographies, steps, self._shape)
        for tie in ties:
            self._graph.tie(tie)
        self._loop_closed = self._loop_closed or is_far
        self._graph.move(homographies)
        joins = self._plane_ties.joins(across, self._graph, self.plane, self._shape, self._is_survey)
        for change, moved, kept in joins:
            self._graph.rebase(change, moved, kept)
            self._references.pop(moved, None)
            self._loop_closed = True
        self._refresh()
        after = self.active.to_reference
        return None if np.array_equal(after, before) else normalised(after @ inverse(before))

    def rebase(self, reference: int, number: int) -> FloatArray:
        """Makes the current plane that of a keyframe, and its number `number`.

        Returns:
            The homography from the old plane to the new.
        """
        change, old = inverse(self._graph.homographies.get(reference, IDENTITY)), self.plane
        self._graph.rebase(change, old, number)
        self._references.pop(old, None)
        self._references[number] = reference
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
        if focal_px > 0:
            problem, indices = found
            lens = Lens(focal_px, centre(self._shape))
            found = replace(problem, fixed=np.zeros_like(problem.fixed), lens=lens), indices
            settings = replace(settings, model=MotionModel.HOMOGRAPHY)
        homographies, rmse = adjusted_homographies(found, settings)
        self._graph.move(homographies)
        self._refresh()
        return rmse

    def retire(self) -> None:
        """Releases what only new frames need; `finish` still works."""
        self.adopt()
        self._stored.clear()
        self._newest = ()

    def close(self) -> None:
        """Ends the threads; that of the patches last, as a running adjustment may wait for them."""
        self._pending = None
        self._adjuster.close(_TIMEOUT_S)
        self._executor.close(_TIMEOUT_S)

    def _adjustment(self) -> AdjustmentSettings:
        return replace(self._settings.adjustment, model=self.rule.model)

    def _refresh(self) -> None:
        """Copies the graph's homographies and planes to the stored keyframes."""
        for index, keyframe in self._stored.items():
            matrix, plane = self._graph.homographies[index], self._graph.planes[index]
            self._stored[index] = replace(keyframe, to_reference=matrix, plane=plane)
        self.plane = self._graph.planes.get(self._active, self.plane)
