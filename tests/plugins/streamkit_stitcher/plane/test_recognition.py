"""How often frames are relocalised while no keyframe matches."""

import pytest

from streamkit.geometry.registration_status import RegistrationStatus
from streamkit_stitcher.plane.anchoring import KeyframeAnchor
from streamkit_stitcher.plane.patch_matching import PatchMatcher

SHAPE = (360, 640)


class Blindness:
    """While on, no keyframe matches, and every relocalisation is recorded.

    Attributes:
        on: whether it is.
        number: of the frame that is placed.
        looks: the frames that were looked for.
    """

    def __init__(self, monkeypatch):
        self.on = True
        self.number = 0
        self.looks = []
        for owner, name in (
            (PatchMatcher, "match"),
            (KeyframeAnchor, "match_near"),
            (KeyframeAnchor, "recognise"),
        ):
            monkeypatch.setattr(owner, name, self._blinded(getattr(owner, name)))

    def _blinded(self, method):
        def call(*arguments, **named):
            if self.on and method.__name__ == "recognise":
                self.looks.append(self.number)
            return None if self.on else method(*arguments, **named)

        return call


@pytest.fixture
def blindness(monkeypatch):
    """As over ground that is no plane: frames lie on the ones before them, but on no keyframe."""
    return Blindness(monkeypatch)


@pytest.fixture
def registrar(make_registrar):
    """A registrar, closed in the end."""
    return make_registrar()


def test_relocalisation_becomes_rarer_while_the_motion_is_known(ground, make_flight, blindness, registrar):
    """Every other frame at first, then every sixteenth; all are weak, and none is lost."""
    flight = make_flight(ground, 400, SHAPE, cars=0)
    registrar.register(flight.frame(0))
    registrations = []
    for blindness.number in range(1, 70):
        registrations.append(registrar.register(flight.frame(blindness.number)))
    assert {registered.status for registered in registrations} == {RegistrationStatus.WEAK}
    assert not any(registered.measured for registered in registrations)
    assert blindness.looks == [1, 3, 5, 17, 33, 49, 65]


def test_a_keyframe_that_is_seen_again_ends_the_pauses(ground, make_flight, blindness, registrar):
    """The first frame that matches is registered; after that, tries are frequent again."""
    flight = make_flight(ground, 400, SHAPE, cars=0)
    registrar.register(flight.frame(0))
    for blindness.number in range(1, 30):
        registrar.register(flight.frame(blindness.number))
    blindness.on = False
    assert registrar.register(flight.frame(30)).measured
    blindness.on = True
    blindness.looks.clear()
    for blindness.number in range(31, 40):
        assert registrar.register(flight.frame(blindness.number)).status is RegistrationStatus.WEAK
    assert blindness.looks == [31, 33, 35]
