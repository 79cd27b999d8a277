"""SettingsOf: an algorithm's settings are the element's properties, and it reads a snapshot of them."""

import enum
from collections.abc import Callable
from dataclasses import FrozenInstanceError, dataclass, field

import pytest

from streamkit import Frame, Pipeline, Property, PropertyError, SettingsOf, Transform
from streamkit.settings import setting

Register = Callable[..., None]


class Mode(enum.StrEnum):
    """How to look."""

    FAST = "fast"
    EXACT = "exact"


@dataclass(frozen=True, slots=True)
class FilterSettings:
    """Of a part of the algorithm."""

    radius: int = setting(3, min=1, max=9, unit="px", doc="Of the median.")


@dataclass(frozen=True, slots=True)
class AlgorithmSettings:
    """Of the algorithm."""

    threshold: float = setting(0.5, min=0.0, max=1.0, live=True, doc="Least.", aliases=("ts",))
    mode: Mode = setting(Mode.FAST, doc="How to look.")
    label: str | None = setting(None, doc="May be left out.")
    filter: FilterSettings = field(default_factory=FilterSettings)
    rounds: int = 4  # a constant of the algorithm, no property


class Works(Transform):
    """Has an algorithm."""

    sink = src = "ANY"
    settings = SettingsOf(AlgorithmSettings)
    own: int = Property(1, doc="Of the element alone.")

    def transform(self, frame: Frame) -> Frame:
        return frame


def test_each_setting_is_a_property() -> None:
    """With its type, range, unit and sentence; those of a nested part, too."""
    assert list(Works.properties) == ["threshold", "mode", "label", "radius", "own"]
    radius = Works.properties["radius"]
    assert (radius.describe(), radius.doc, radius.live) == ("int 1..9 px", "Of the median.", False)
    assert Works.properties["mode"].choices == ("fast", "exact")


def test_the_algorithm_reads_a_snapshot() -> None:
    """It is frozen, made anew when a property was set, and the same object until then."""
    element = Works("w")
    before = element.settings
    assert before == AlgorithmSettings()
    assert element.settings is before
    element.set_property("radius", "5")
    element.set_property("mode", "exact")
    assert element.settings == AlgorithmSettings(mode=Mode.EXACT, filter=FilterSettings(5))
    assert before.filter.radius == 3
    with pytest.raises(FrozenInstanceError):
        element.settings.threshold = 0.1  # type: ignore[misc]


def test_elements_do_not_share_their_settings() -> None:
    """Each has its own values."""
    first, second = Works("a", threshold=0.1), Works("b")
    assert (first.settings.threshold, second.settings.threshold) == (0.1, 0.5)


def test_a_wrong_value_is_refused_with_the_declared_rule() -> None:
    """The same error as for any property."""
    with pytest.raises(PropertyError, match=r"^w: property radius cannot be 12: it takes int 1..9 px$"):
        Works("w").set_property("radius", 12)


def test_an_older_name_is_accepted_with_a_warning(register: Register) -> None:
    """In descriptions and by call; it says the new name, which the graph then shows."""
    register(works=Works)
    element = Works("w")
    reported: list[str] = []
    element.poster = lambda message: reported.append(message.text)
    element.set_property("ts", 0.25)
    assert element.settings.threshold == 0.25
    assert reported == ["property ts is called threshold now; use that name"]
    with Pipeline.parse("fakesrc ! works name=w ts=0.75 ! fakesink") as pipeline:
        assert pipeline["w"].settings.threshold == 0.75
        assert pipeline["w"].properties_set() == {"threshold": 0.75}
        assert pipeline.graph.warnings == [
            ("renamed-property", "w: ts is called threshold now; use that name")
        ]


def test_a_live_setting_reaches_the_next_frame(register: Register) -> None:
    """One that is not live is refused while the pipeline plays."""
    register(works=Works)
    with Pipeline.parse("fakesrc ! works name=w ! fakesink") as pipeline:
        pipeline.play()
        pipeline["w"].set_property("threshold", 0.9)
        assert pipeline["w"].settings.threshold == 0.9
        with pytest.raises(PropertyError, match="cannot change while playing"):
            pipeline["w"].set_property("radius", 4)
