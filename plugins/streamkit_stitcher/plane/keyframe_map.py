"""The key pictures of one plane: where they lie, what ties them, and the adjustment that moves them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from streamkit.geometry.homography import IDENTITY, FloatArray, GreyArray, inverse, normalised
from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings
from streamkit_stitcher.bundle_adjustment.problem import CameraModel
from streamkit_stitcher.plane.adjuster import Adjuster, AdjustmentJob, adjusted_places
from streamkit_stitcher.plane.closures import FEW_STEPS, ClosureEvidence
from streamkit_stitcher.plane.graph import KeyframeGraph, Tie
from streamkit_stitcher.plane.key_picture import LEVELS, Beside, key_picture
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
_MOST_PLACES: Final = 20_000


class KeyframeMap:
    """Keeps the key pictures of a plane at places that agree with each other.

    Args:
        settings: the tracker's settings.

    Attributes:
        beside: works out what the next picture needs of a key picture.
    """

    def __init__(self, settings: PlaneSettings) -> None:
        self._settings = settings
        self._store = KeyframeStore(settings.max_keyframes)
        self._graph = KeyframeGraph(settings.max_adjusted)
        self._adjuster = Adjuster()
        self._closures = ClosureEvidence()
        self.beside = Beside()
        self._selection = ModelSelection()
        self._reference = 0
        self._closed_loops = False
        self._active: Keyframe | None = None

    def __len__(self) -> int:
        return len(self._graph)

    @property
    def active(self) -> Keyframe | None:
        """The key picture that pictures are measured against."""
        return self._active

    @property
    def stored(self) -> tuple[Keyframe, ...]:
        """The key pictures that can still be looked for, oldest first."""
        return self._store.keyframes

    @property
    def places(self) -> Mapping[int, FloatArray]:
        """float64[3, 3] of each key picture of the plane, its pixels to the reference plane.

        Of the newest 20 000, and of all that can still be looked for.
        """
        return self._graph.places

    @property
    def model(self) -> MotionModel:
        """What the motion between pictures may be, as far as is known."""
        if self._settings.model is ModelChoice.AUTO:
            return self._selection.model
        return MotionModel(self._settings.model.value)

    @property
    def rule(self) -> MotionRule:
        """What a picture's motion may be; `auto` lets single pictures differ from the rest."""
        return MotionRule(self.model, firm=self._settings.model is not ModelChoice.AUTO)

    @property
    def is_adjusting(self) -> bool:
        """Whether an adjustment was begun whose result was not adopted."""
        return self._adjuster.is_busy

    def tied_to(self, index: int) -> set[int]:
        """The earlier key pictures that a key picture shares tie points with."""
        return self._graph.hosts(index)

    def overlapping(
        self, to_reference: FloatArray, shape: tuple[int, int], least: float
    ) -> list[tuple[float, Keyframe]]:
        """The stored key pictures that share ground with a picture, see `KeyframeStore.overlapping`."""
        return self._store.overlapping(to_reference, shape, least)

    def activate(self, keyframe: Keyframe) -> None:
        """Has pictures measured against another of the key pictures."""
        self._active = keyframe

    def current(self, keyframe: Keyframe) -> Keyframe:
        """A key picture at the place it has by now."""
        return replace(keyframe, to_reference=self._graph.places.get(keyframe.index, keyframe.to_reference))

    def learn(self, match: KeyframeMatch) -> None:
        """Takes the match of two key pictures as evidence of what the motion may be."""
        firm = match.on_plane()
        self._selection.add(firm.frame_points, firm.key_points)

    def add(
        self,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        level: int,
        ties: Sequence[Tie],
    ) -> Keyframe:
        """Makes a picture a key picture, and the active one.

        Args:
            images: the picture and its halvings down to working size.
            to_reference: float64[3, 3], its pixels to the reference plane.
            level: which of the images is at working size.
            ties: to earlier key pictures, with any observer.
        """
        shape = (images[0].shape[0], images[0].shape[1])
        # Copies: the picture may be a view of a frame that somebody else reuses.
        own = tuple(image.copy() for image in images[: level + 1])
        content = self.beside.begin(key_picture, own, level)
        self._active = self._store.add(content, to_reference, shape, level)
        index = self._active.index
        self._graph.add(index, to_reference, [replace(tie, observer=index) for tie in ties])
        self._graph.forget(_MOST_PLACES, {*(keyframe.index for keyframe in self.stored), self._reference})
        return self._active

    def begin_adjustment(
        self, images: Sequence[GreyArray], description: Description | None = None, whole: bool = False
    ) -> None:
        """Sets the worker to adjust the newest key pictures; `adopt` must have taken what it did before.

        Args:
            images: the newest key picture and its halvings.
            description: what it is recognised by, if that was worked out before.
            whole: whether up to 60 key pictures are to be adjusted, as after a loop was closed.
        """
        if self._active is None or self._settings.window <= 0:
            return
        candidates = self._loop_candidates(self._active)
        tied = self._graph.tied
        free = tied[-_WHOLE_LIMIT:] if whole or self._closed_loops else tied[-self._settings.window :]
        steps = self._graph.steps_from(self._active.index) if candidates else {}
        near = frozenset(index for index, count in steps.items() if count <= FEW_STEPS)
        problem, indices = self._graph.problem(free, self._reference) or (None, ())
        self._closed_loops = False
        if problem is None and not candidates:
            return
        # Copies: the picture may be a view of a frame that somebody else reuses.
        own = pyramid(tuple(image.copy() for image in images), LEVELS) if candidates else ()
        settings = self._adjustment(self._settings.adjustment_iterations)
        self._adjuster.submit(
            AdjustmentJob(problem, indices, settings, self._active, own, candidates, near, description)
        )

    def adopt(self) -> FloatArray | None:
        """Takes over what the worker found, once it is done.

        Returns:
            How the plane moved under the current key picture, float64[3, 3] old to new, or None.
        """
        result = self._adjuster.take()
        ties = self._believed(result.ties)
        for tie in ties:
            self._graph.tie(tie)
        self._closed_loops = self._closed_loops or (bool(ties) and self._closures.is_far)
        return self._move(result.places)

    def rebase(self, reference: int) -> FloatArray:
        """Makes a key picture's plane the reference; returns float64[3, 3], old plane to new."""
        place = self._graph.places.get(reference, IDENTITY)
        change = inverse(place)
        self._graph.rebase(change)
        self._reference = reference
        self._refresh()
        return change

    def finish(self) -> float:
        """Adjusts all key pictures that can be; returns the root mean square residual of the ties, px."""
        self.adopt()
        found = self._graph.problem(self._graph.tied, self._reference)
        if found is None:
            return 0.0
        places, rmse, _ = adjusted_places(*found, self._adjustment(_FINAL_ITERATIONS))
        self._move(places)
        return rmse

    def retire(self) -> None:
        """Lets go of what only new pictures need: patches, by far the most of the memory, and the workers.

        An adjustment that was begun ends by itself; `finish` waits for it.
        """
        self._store, self._active = KeyframeStore(0), None
        self.beside.close()
        self._adjuster.retire()

    def close(self) -> None:
        """Ends the workers."""
        self._adjuster.close()
        self.beside.close()

    def _adjustment(self, iterations: int) -> AdjustmentSettings:
        return AdjustmentSettings(
            CameraModel(self.model.value), self._settings.huber, iterations, tolerance=1e-5
        )

    def _loop_candidates(self, keyframe: Keyframe) -> tuple[Keyframe, ...]:
        """Key pictures that should show the same ground but have no tie to the newest."""
        tied = self._graph.hosts(keyframe.index)
        return tuple(
            other
            for _, other in self._store.overlapping(keyframe.to_reference, keyframe.shape, _LOOP_OVERLAP)
            if other.index < keyframe.index - 2 and other.index not in tied
        )[:_LOOP_CANDIDATES]

    def _believed(self, ties: Sequence[Tie]) -> tuple[Tie, ...]:
        """Which of the ties that the worker found across strips can be trusted."""
        if not ties or self._active is None:
            return ()
        steps = self._graph.steps_from(ties[0].observer)
        return self._closures.believed(ties, self._graph.places, steps, self._active.shape)

    def _move(self, places: Mapping[int, FloatArray]) -> FloatArray | None:
        if not places:
            return None
        before = self._active
        self._graph.move(places)
        self._refresh()
        if before is None or self._active is None or before.index not in places:
            return None
        return normalised(self._active.to_reference @ inverse(before.to_reference))

    def _refresh(self) -> None:
        """Gives the stored key pictures the graph's places."""
        self._store.move(self._graph.places)
        if self._active is not None:
            self._active = replace(
                self._active, to_reference=self._graph.places.get(self._active.index, IDENTITY)
            )
