"""Whether a target is still the same one, and where it is if not."""

from types import ModuleType

import numpy as np

from streamkit_tracker.appearance.correlation_filter import CorrelationFilter, FilterHistory
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
        self.filters = FilterHistory(CorrelationFilter(self.sampler, DRAWN))

    def show(self, window: np.ndarray | None) -> None:
        """The next frame: the target at a window, or the ground alone."""
        picture = self._ground if window is None else self._scenes.paint(self._ground, self._texture, window)
        self.sampler.set_frame(self._scenes.grey(picture, self._generator, 2.0))

    def follow(self, window: np.ndarray, *, seen: bool = True) -> None:
        """What the tracker does with a window in a frame: the filter learns whatever is there."""
        region = self.filters.latest.features.read(self.sampler, window) if seen else None
        if region is not None:
            self.filters.latest.learn(self.sampler, region)
        self.filters.update_sharpness(region)


def test_a_target_that_stays_is_sure(scenes: ModuleType):
    """From the first frame on."""
    film = Film(scenes)
    for _ in range(40):
        film.show(DRAWN)
        film.follow(DRAWN)
        assert film.filters.is_sure


def test_ground_in_its_place_is_not_sure_though_the_filter_has_learnt_it(scenes: ModuleType):
    """Within 40 frames, and for good: the copy has not learnt the ground."""
    film = Film(scenes)
    sure = []
    for _ in range(120):
        film.show(None)
        film.follow(DRAWN)
        sure.append(film.filters.is_sure)
    assert not any(sure[40:])
    assert film.filters.latest.respond(film.sampler, DRAWN).sharpness > 10


def test_a_target_that_is_not_seen_is_soon_not_sure(scenes: ModuleType):
    """Whatever the ground looks like."""
    film = Film(scenes)
    film.show(DRAWN)
    film.follow(DRAWN)
    for _ in range(40):
        film.follow(DRAWN, seen=False)
    assert not film.filters.is_sure


def test_a_target_in_doubt_is_sure_only_by_sharper_responses(scenes: ModuleType):
    """What is sharp enough for a target in its place is not for one that its detector finds elsewhere."""
    film = Film(scenes)
    film.filters.sharpness = 12.0
    assert film.filters.is_sure
    film.filters.is_doubted = True
    assert not film.filters.is_sure
    film.filters.sharpness = 20.0
    assert film.filters.is_sure
