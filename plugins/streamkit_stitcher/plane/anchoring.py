"""Measuring pictures against key pictures, and choosing which picture becomes one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from streamkit_stitcher.bundle_adjustment.adjustment import AdjustmentSettings
from streamkit_stitcher.bundle_adjustment.problem import CameraModel
from streamkit_stitcher.homographies import (
    IDENTITY,
    FloatArray,
    GreyArray,
    inverse,
    normalised,
    overlap,
    scale_change,
)
from streamkit_stitcher.plane.adjuster import Adjuster, AdjustmentJob, adjusted_places
from streamkit_stitcher.plane.graph import KeyframeGraph, Tie
from streamkit_stitcher.plane.keyframes import (
    LEVELS,
    Keyframe,
    KeyframeMatch,
    KeyframeMatcher,
    KeyframeStore,
    pooled_placement,
)
from streamkit_stitcher.plane.loop_closure import Recogniser, better, tie_of
from streamkit_stitcher.plane.settings import ModelChoice, PlaneSettings
from streamkit_stitcher.registration.corners import CornerDetector
from streamkit_stitcher.registration.descriptors import Description, describe
from streamkit_stitcher.registration.model_selection import ModelSelection
from streamkit_stitcher.registration.motion_models import FitLimits, MotionModel
from streamkit_stitcher.registration.patches import pyramid

_KEY_POINTS: Final = 400
_POOLED_POINTS: Final = 250
_POOLED: Final = 4
_POOLED_OVERLAP: Final = 0.25
_LOOP_OVERLAP: Final = 0.12
_LOOP_CANDIDATES: Final = 3
_LOOK_BACK_MARGIN: Final = 0.1
_LOOK_BACK_TRIES: Final = 2
_RECOGNISED: Final = 3
_SCALE_RANGE: Final = (0.8, 1.25)
_MAX_UNMATCHED: Final = 3
_FOLLOW_LEVEL: Final = 1
_FOLLOW_POINTS: Final = 48
_WHOLE_LIMIT: Final = 60
_FINAL_ITERATIONS: Final = 30


@dataclass(frozen=True, eq=False)
class Anchored:
    """A picture's place after comparison with key pictures.

    Attributes:
        to_reference: float64[3, 3], the picture's pixels to the reference plane.
        measured: whether a key picture was found in it; otherwise the place is the one carried forward.
        change: float64[3, 3], how the plane moved under the picture, old to new, because another key picture
            took over or places were adjusted; None where it did not.
        keyframe: whether the picture became a key picture.
        matches: patches compared.
        inliers: patches that agree with the place.
        rmse: root mean square distance of the inliers, px.
    """

    to_reference: FloatArray
    measured: bool
    change: FloatArray | None = None
    keyframe: bool = False
    matches: int = 0
    inliers: int = 0
    rmse: float = 0.0


class KeyframeAnchor:
    """Holds pictures to the reference plane by the key picture they lie on.

    Args:
        settings: the tracker's settings.
        level: how often pictures are halved for following; sets how far from the carried place to search.
    """

    def __init__(self, settings: PlaneSettings, level: int) -> None:
        self._settings = settings
        self._limits: FitLimits = replace(
            settings.limits, threshold=settings.limits.threshold * 2**level, max_step=1.0
        )
        self._level = level
        self._search_level = max(0, level - 1)
        self._store = KeyframeStore(settings.max_keyframes)
        self._matcher = KeyframeMatcher()
        self._recogniser = Recogniser()
        self._detector = CornerDetector()
        self._selection = ModelSelection()
        self._graph = KeyframeGraph(settings.max_adjusted)
        self._adjuster = Adjuster()
        self._reference = 0
        self._closed_loops = False
        self._described: Description | None = None
        self._active: Keyframe | None = None
        self._unmatched = 0

    @property
    def active(self) -> Keyframe | None:
        """The key picture that pictures are measured against."""
        return self._active

    @property
    def places(self) -> Mapping[int, FloatArray]:
        """float64[3, 3] of each key picture of the plane, its pixels to the reference plane."""
        return self._graph.places

    def tied_to(self, index: int) -> set[int]:
        """The earlier key pictures that a key picture shares tie points with."""
        return self._graph.hosts(index)

    @property
    def model(self) -> MotionModel:
        """What the motion between pictures may be, as far as is known."""
        if self._settings.model is ModelChoice.AUTO:
            return self._selection.model
        return MotionModel(self._settings.model.value)

    def add(
        self, images: Sequence[GreyArray], to_reference: FloatArray, ties: Sequence[Tie] = ()
    ) -> Keyframe:
        """Makes a picture the current key picture.

        Args:
            images: the picture and its halvings.
            to_reference: float64[3, 3], its pixels to the reference plane.
            ties: to earlier key pictures, with any observer.
        """
        factor = 2**self._level
        corners = self._detector.detect(images[self._level], _KEY_POINTS)
        points = corners * factor + (factor - 1) / 2
        levels = max(LEVELS, self._level + 1)
        self._active = self._store.add(pyramid(images, levels), points, to_reference, self._level)
        index = self._active.index
        if self._described is not None:
            self._recogniser.remember(self._active, self._described)
        self._graph.add(index, to_reference, [replace(tie, observer=index) for tie in ties])
        self._unmatched = 0
        return self._active

    def follow(self, images: Sequence[GreyArray], expected: FloatArray) -> KeyframeMatch | None:
        """Looks for the current key picture near the expected place.

        Args:
            images: the picture and its halvings.
            expected: float64[3, 3], its place if the camera goes on as it did.
        """
        if self._active is None:
            return None
        return self._match(self._active, images, expected, _FOLLOW_LEVEL, coarse=_FOLLOW_POINTS)

    def recognise(self, small: GreyArray) -> KeyframeMatch | None:
        """Looks for a picture of unknown motion in the newest key pictures, by what it shows.

        The one in which it is seen becomes the current one.

        Args:
            small: uint8[h, w], the picture at working size.
        """
        if self._active is None:
            return None
        description = self._described = describe(small)
        recent = [keyframe for keyframe in self._store.keyframes if keyframe.index != self._active.index]
        for keyframe in [self._active, *recent[::-1][: _RECOGNISED - 1]]:
            seen = self._recogniser.place(description, keyframe)
            if seen is not None:
                self._active = keyframe
                return seen
        return None

    def place(
        self,
        images: Sequence[GreyArray],
        carried: FloatArray,
        trusted: bool,
        followed: KeyframeMatch | None = None,
        seen: KeyframeMatch | None = None,
        due: bool = False,
    ) -> Anchored:
        """Measures where a picture lies, and makes it a key picture where one is due.

        Args:
            images: the picture and its halvings.
            carried: float64[3, 3], its place by the motion since the last picture.
            trusted: whether that motion was measured by a homography; otherwise the search is wider and the
                carried place is not good enough for a key picture.
            followed: what `follow` found, which saves the search.
            seen: what `recognise` found, from where the search begins.
            due: whether it should become a key picture in any case.
        """
        if seen is None:
            self._described = None
        if self._active is None:
            return Anchored(carried, measured=False)
        match = followed
        if seen is not None:
            carried = normalised(self._active.to_reference @ seen.fit.matrix)
            match = better(seen, self._match(self._active, images, carried, LEVELS - 1))
        if match is None:
            level = self._search_level if trusted else LEVELS - 1
            match = self._match(self._active, images, carried, level)
        if match is None and trusted:
            match = self._match(self._active, images, carried, LEVELS - 1)
        place = _placed(self._active, match) if match is not None else Anchored(carried, measured=False)
        self._unmatched = 0 if match is not None else self._unmatched + 1
        if match is not None and not due and not self._is_leaving(self._active, place.to_reference):
            return place
        back = None if due or seen is not None else self._look_back(self._active, images, place)
        if back is not None:
            return back
        if match is None and (not trusted or self._unmatched < _MAX_UNMATCHED):
            return place
        return self._promote(images, place, None if match is None else (self._active, match))

    def _is_leaving(self, keyframe: Keyframe, to_reference: FloatArray) -> bool:
        to_key = normalised(inverse(keyframe.to_reference) @ to_reference)
        scale = scale_change(to_key, keyframe.shape)
        share = overlap(to_key, keyframe.shape)
        return share < self._settings.keyframe_overlap or not _SCALE_RANGE[0] < scale < _SCALE_RANGE[1]

    def _look_back(self, active: Keyframe, images: Sequence[GreyArray], place: Anchored) -> Anchored | None:
        """Lets an earlier key picture take over where the camera has come back to it."""
        least = self._settings.keyframe_overlap + _LOOK_BACK_MARGIN if place.measured else _POOLED_OVERLAP
        found = self._store.overlapping(place.to_reference, active.shape, min(least, 0.95))
        candidates = [keyframe for _, keyframe in found if keyframe.index != active.index]
        for keyframe in candidates[:_LOOK_BACK_TRIES]:
            match = self._match(keyframe, images, place.to_reference, LEVELS - 1)
            if match is not None:
                self._active = keyframe
                self._unmatched = 0
                back = _placed(keyframe, match)
                return replace(back, change=normalised(back.to_reference @ inverse(place.to_reference)))
        return None

    def _promote(
        self, images: Sequence[GreyArray], place: Anchored, known: tuple[Keyframe, KeyframeMatch] | None
    ) -> Anchored:
        """Makes the picture a key picture, placed by all key pictures it shares ground with.

        Args:
            images: the picture and its halvings.
            place: where it lies.
            known: the key picture it was measured against, which counts where it is not matched better.
        """
        change = self.adopt() if self.is_adjusting else None
        if change is not None:
            place = replace(place, to_reference=normalised(change @ place.to_reference))
        shape = (images[0].shape[0], images[0].shape[1])
        matches: list[tuple[Keyframe, KeyframeMatch]] = []
        for _, keyframe in self._store.overlapping(place.to_reference, shape, _POOLED_OVERLAP)[:_POOLED]:
            match = self._match(keyframe, images, place.to_reference, self._search_level, _POOLED_POINTS)
            if match is not None:
                matches.append((keyframe, match))
                self._selection.add(match.frame_points, match.key_points)
        pooled = None
        if known is not None and known[0].index not in {keyframe.index for keyframe, _ in matches}:
            matches.append((self._current(known[0]), known[1]))
            self._selection.add(known[1].frame_points, known[1].key_points)
        elif matches:
            pooled = pooled_placement(matches, shape, self._limits, self.model)
        if pooled is not None:
            place = Anchored(
                pooled.matrix, True, matches=len(pooled.inliers), inliers=pooled.count, rmse=pooled.rmse
            )
        self.add(images, place.to_reference, [tie_of(keyframe, 0, match) for keyframe, match in matches])
        return replace(place, keyframe=True, change=change)

    def begin_adjustment(self, images: Sequence[GreyArray], whole: bool = False) -> None:
        """Sets the worker to adjust the newest key pictures; `adopt` must have taken what it did before.

        Args:
            images: the newest key picture and its halvings.
            whole: whether up to 60 key pictures are to be adjusted, as after a loop was closed.
        """
        if self._active is None or self._settings.window <= 0:
            return
        candidates = self._loop_candidates(self._active)
        tied = self._graph.tied
        free = tied[-_WHOLE_LIMIT:] if whole or self._closed_loops else tied[-self._settings.window :]
        found = self._graph.problem(free, self._reference)
        self._closed_loops = False
        problem, indices = found if found is not None else (None, ())
        if problem is None and not candidates:
            return
        own = tuple(image.copy() for image in images) if candidates else ()
        settings = self._adjustment(self._settings.adjustment_iterations)
        self._adjuster.submit(
            AdjustmentJob(
                problem,
                indices,
                settings,
                self._active,
                pyramid(own, LEVELS) if own else (),
                candidates,
                self._described,
            )
        )

    @property
    def is_adjusting(self) -> bool:
        """Whether an adjustment was begun whose result was not adopted."""
        return self._adjuster.is_busy

    def adopt(self) -> FloatArray | None:
        """Takes over what the worker found, once it is done.

        Returns:
            How the plane moved under the current key picture, float64[3, 3] old to new, or None.
        """
        result = self._adjuster.take()
        for tie in result.ties:
            self._graph.tie(tie)
        self._closed_loops = self._closed_loops or bool(result.ties)
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

    def close(self) -> None:
        """Ends the worker."""
        self._adjuster.close()

    @property
    def count(self) -> int:
        """Number of key pictures of the plane."""
        return len(self._graph)

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

    def _move(self, places: Mapping[int, FloatArray]) -> FloatArray | None:
        if not places:
            return None
        before = self._active
        self._graph.move(places)
        self._refresh()
        if before is None or self._active is None or before.index not in places:
            return None
        return normalised(self._active.to_reference @ inverse(before.to_reference))

    def _current(self, keyframe: Keyframe) -> Keyframe:
        """A key picture at the place it has by now."""
        return replace(keyframe, to_reference=self._graph.places.get(keyframe.index, keyframe.to_reference))

    def _refresh(self) -> None:
        """Gives the stored key pictures the graph's places."""
        self._store.move(self._graph.places)
        if self._active is not None:
            self._active = replace(
                self._active, to_reference=self._graph.places.get(self._active.index, IDENTITY)
            )

    def _match(
        self,
        keyframe: Keyframe,
        images: Sequence[GreyArray],
        to_reference: FloatArray,
        top_level: int,
        most: int = 0,
        coarse: int = 96,
    ) -> KeyframeMatch | None:
        return self._matcher.match(
            keyframe,
            pyramid(images, top_level + 1),
            normalised(inverse(keyframe.to_reference) @ to_reference),
            self._limits,
            top_level=top_level,
            max_points=most or self._settings.max_points,
            model=self.model,
            coarse_points=coarse,
        )


def _placed(keyframe: Keyframe, match: KeyframeMatch) -> Anchored:
    return Anchored(
        normalised(keyframe.to_reference @ match.fit.matrix),
        measured=True,
        matches=len(match.fit.inliers),
        inliers=match.fit.count,
        rmse=match.fit.rmse,
    )
