"""Whether a target is still the same one, and where it is if not."""

from types import ModuleType

import numpy as np

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter
from streamkit_tracker.appearance.filter_copies import FilterCopies
from streamkit_tracker.appearance.window_sampling import WindowSampler

DRAWN = np.array([150.0, 120, 40, 34, 0.0])


class Film:
    """A textured target on a textured ground, and its filter from the first frame."""

    def __init__(self, scenes: ModuleType) -> None:
        self._scenes, self._generator = scenes, np.random.default_rng(4)
        self._ground = scenes.ground(self._generator, 240, 320)
        self._texture = scenes.blob_texture(self._generator)
        self.sampler = WindowSampler()
        self.show(DRAWN)
        self.filter = CorrelationFilter(self.sampler, DRAWN)
        self.copies = FilterCopies(self.filter)

    @property
    def is_sure(self) -> bool:
        """Where no detector contradicts."""
        return self.copies.is_sure(is_contradicted=False)

    def show(self, window: np.ndarray | None) -> None:
        """The next frame: the target at a window, or the ground alone."""
        picture = self._ground if window is None else self._scenes.paint(self._ground, self._texture, window)
        self.sampler.set_frame(self._scenes.grey(picture, self._generator, 2.0))

    def follow(self, window: np.ndarray, *, seen: bool = True) -> None:
        """What the tracker does with a window in a frame: the filter learns whatever is there."""
        region = self.filter.features.read(self.sampler, window) if seen else None
        if region is not None:
            self.filter.learn(self.sampler, region)
        self.copies.compare(region)
        if self.is_sure:
            self.copies.add(self.filter)


def test_a_target_that_stays_is_sure(scenes: ModuleType):
    """From the first frame on."""
    film = Film(scenes)
    for _ in range(40):
        film.show(DRAWN)
        film.follow(DRAWN)
        assert film.is_sure


def test_ground_in_its_place_is_not_sure_though_the_filter_has_learnt_it(scenes: ModuleType):
    """Within 40 frames, and for good: the copy has not learnt the ground."""
    film = Film(scenes)
    sure = []
    for _ in range(120):
        film.show(None)
        film.follow(DRAWN)
        sure.append(film.is_sure)
    assert not any(sure[40:])
    assert film.filter.respond(film.sampler, DRAWN).sharpness > 10


def test_a_target_that_is_not_seen_is_soon_not_sure(scenes: ModuleType):
    """Whatever the ground looks like."""
    film = Film(scenes)
    film.show(DRAWN)
    film.follow(DRAWN)
    for _ in range(40):
        film.follow(DRAWN, seen=False)
    assert not film.is_sure


def test_a_contradicted_target_is_sure_only_by_sharper_responses(scenes: ModuleType):
    """What is sharp enough for a target in its place is not for one that its detector finds elsewhere."""
    film = Film(scenes)
    film.copies.sharpness = 12.0
    assert film.copies.is_sure(is_contradicted=False)
    assert not film.copies.is_sure(is_contradicted=True)
    film.copies.sharpness = 20.0
    assert film.copies.is_sure(is_contradicted=True)
