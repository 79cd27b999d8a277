"""Properties: declared once, checked whenever they are set."""

import enum
import re
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest

from streamkit import Caps, Element, Message, Property, PropertyError, Sink, Source, Transform
from streamkit.element.branching import Combine
from streamkit.element.output_sink import NumberedFilesSink, TextFileSink
from streamkit.element.property import NAME, use_of


class Mode(enum.StrEnum):
    """Two ways."""

    FAST = "fast"
    EXACT = "exact"


class Sample(Element):
    """One property of each type."""

    count: int = Property(3, min=0, max=10, unit="px", doc="A number.")
    gain: float = Property(1.0, min=0.0, live=True)
    on: bool = Property(False)
    label: str = Property("none")
    rate: Fraction = Property(Fraction(25))
    caps: Caps = Property(Caps("ANY"))
    mode: Mode = Property(Mode.FAST)
    place: str | None = Property(None)
    password: str = Property("", secret=True)
    token: int = Property(0, max=9, secret=True)


class Derived(Sample):
    """Adds one and changes one."""

    extra: int = Property(1)
    count: int = Property(7, max=7)


@pytest.mark.parametrize("path", ["~/flight.mp4", Path("~/flight.mp4")])
def test_the_home_in_a_name_of_a_file(path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shell leaves it alone inside the quotes of a description; elsewhere it is a letter."""

    class Reader(Element):
        location: str = Property("", file="read")
        text: str = Property("")

    monkeypatch.setenv("HOME", "/home/me")
    assert Reader(location=path).location == "/home/me/flight.mp4"
    assert Reader(location="./~/flight.mp4").location == "./~/flight.mp4"
    assert Reader(text="~/flight.mp4").text == "~/flight.mp4"


def test_defaults_are_those_declared() -> None:
    """A new element has the declared values, and no other element's."""
    one, two = Sample(), Sample(count=5)
    assert (one.count, one.gain, one.mode, one.place) == (3, 1.0, Mode.FAST, None)
    assert (two.count, one.count) == (5, 3)


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("count", "0x0a", 10),
        ("count", 4, 4),
        ("gain", 2, 2.0),
        ("gain", "1e1", 10.0),
        ("on", "yes", True),
        ("label", "5", "5"),
        ("rate", "30000/1001", Fraction(30000, 1001)),
        ("rate", 30, Fraction(30)),
        ("rate", 29.97002997, Fraction(30000, 1001)),
        ("rate", 29.97, Fraction(30000, 1001)),
        ("rate", 12.5, Fraction(25, 2)),
        ("rate", Fraction(1, 1800), Fraction(1, 1800)),
        ("caps", "video/x-raw", Caps("video/x-raw")),
        ("mode", "exact", Mode.EXACT),
        ("mode", "1", Mode.EXACT),
        ("mode", Mode.EXACT, Mode.EXACT),
        ("place", "x", "x"),
        ("place", None, None),
    ],
)
def test_values_are_converted_to_the_type_of_the_property(name: str, given: Any, value: Any) -> None:
    """From text and from similar Python types."""
    element = Sample()
    element.set_property(name, given)
    found = getattr(element, name)
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("count", "x", "s: property count cannot be 'x': it takes a whole number such as 12, -1 or 0x10"),
        ("count", 1.5, "s: property count cannot be 1.5: it takes int 0..10 px"),
        ("count", True, "s: property count cannot be True: it takes int 0..10 px"),
        ("count", 11, "s: property count cannot be 11: it takes int 0..10 px"),
        ("count", "-1", "s: property count cannot be -1: it takes int 0..10 px"),
        ("gain", float("nan"), "s: property gain cannot be nan: it takes float 0.0.."),
        ("gain", "1/2", "s: property gain cannot be '1/2': it takes a number such as 0.5 or 1e3"),
        ("on", "maybe", "s: property on cannot be 'maybe': it takes true, yes, t, 1 or false, no, f, 0"),
        ("on", 1, "s: property on cannot be 1: it takes bool"),
        ("rate", "x", "s: property rate cannot be 'x': it takes a fraction such as 30/1"),
        ("mode", "slow", "s: property mode cannot be 'slow': it takes fast, exact"),
        ("label", 5, "s: property label cannot be 5: it takes str"),
        ("label", None, "s: property label cannot be None: it takes str"),
        ("caps", "a/b, ;;", "s: property caps cannot be"),
    ],
)
def test_a_refused_value_says_element_property_value_and_rule(name: str, given: Any, message: str) -> None:
    """Nothing is clamped: the message has the value and the rule."""
    element = Sample("s")
    before = getattr(element, name)
    with pytest.raises(PropertyError, match=f"^{re.escape(message)}"):
        element.set_property(name, given)
    assert getattr(element, name) == before


def test_dashes_and_underscores_are_the_same() -> None:
    """Descriptions write kebab-case, Python snake_case; case matters."""

    class Dashed(Element):
        """A name of two words."""

        two_words: int = Property(0)

    element = Dashed("d")
    element.set_property("two-words", 4)
    element.set_property("two_words", element.two_words + 1)
    assert element.two_words == 5
    with pytest.raises(
        PropertyError, match=re.escape("dashed has no property 'two-wrds'; did you mean \"two-words\"?")
    ):
        element.set_property("two-wrds", 1)


def test_only_live_properties_change_while_playing() -> None:
    """The message says that the pipeline must be stopped."""
    element = Sample("s")
    element.is_playing = True
    element.set_property("gain", 2.0)
    with pytest.raises(
        PropertyError, match=r"^s: property count cannot change while playing; stop the pipeline to set it$"
    ):
        element.set_property("count", 4)
    element.is_playing = False
    element.set_property("count", 4)
    assert (element.gain, element.count) == (2.0, 4)


def test_property_changed_is_called() -> None:
    """After each successful set, with the Python name."""

    class Listening(Element):
        """Notes what changed."""

        two_words: int = Property(0, max=3)

        def __init__(self, name: str = "", **properties: Any) -> None:
            self.heard: list[tuple[str, int]] = []
            super().__init__(name, **properties)

        def property_changed(self, name: str) -> None:
            self.heard.append((name, self.two_words))

    element = Listening(two_words=2)
    with pytest.raises(PropertyError):
        element.set_property("two-words", 4)
    assert element.heard == [("two_words", 2)]


def test_secrets_are_never_shown() -> None:
    """Neither in exports nor in errors."""
    element = Sample("s", password="hunter2")
    declared = Sample.properties
    assert declared["password"].to_json(element.password) == "***"
    for given in (4711, "4711"):
        with pytest.raises(PropertyError) as caught:
            element.set_property("token", given)
        assert "4711" not in str(caught.value)
        assert "token cannot be the value given" in str(caught.value)


def test_values_as_json() -> None:
    """Enums by their word, fractions and caps by their text, the rest as it is."""
    declared = Sample.properties
    assert declared["mode"].to_json(Mode.EXACT) == "exact"
    assert declared["rate"].to_json(Fraction(30)) == "30"
    assert declared["caps"].to_json(Caps("a/b")) == "a/b"
    assert declared["place"].to_json(None) is None
    assert declared["count"].to_json(4) == 4


def test_properties_are_inherited() -> None:
    """Those of the bases come first; a subclass may redeclare one."""
    assert list(Derived.properties)[: len(Sample.properties)] == list(Sample.properties)
    assert Derived().extra == 1
    assert (Derived().count, Sample().count) == (7, 3)
    with pytest.raises(PropertyError):
        Derived(count=8)
    assert Sample(count=8).count == 8


def test_a_declaration_describes_itself() -> None:
    """Type, range, unit and choices, as `inspect` and the documentation print them."""
    declared = Sample.properties
    assert declared["count"].describe() == "int 0..10 px"
    assert declared["gain"].describe() == "float 0.0.."
    assert declared["mode"].describe() == "fast | exact"
    assert declared["mode"].choices == ("fast", "exact")
    assert declared["place"].optional
    assert not declared["label"].optional
    assert declared["gain"].live
    assert declared["count"].doc == "A number."


def test_a_property_is_of_a_type_that_a_description_can_write() -> None:
    """When the class is made; `inspect` ended with a traceback, a bin in a process with another reason."""
    with pytest.raises(
        TypeError, match=r"Wrong.folder: a property is int, .*got \w*Path; write str with file="
    ):

        class Wrong(Element):
            """A path."""

            folder: Path = Property(Path())


def test_an_annotation_of_two_types_is_an_error() -> None:
    """The message names class and property, when the class is made."""
    with pytest.raises(
        TypeError, match=r"property Wrong.value: annotate it with one type, or `type \| None`"
    ):

        class Wrong(Element):
            """Two types."""

            value: int | str = Property(0)


class Renamed(Element):
    """Properties called otherwise than their attributes, and some that can only be read."""

    is_async: bool = Property(True, name="async", doc="A word Python keeps for itself.")
    first_s: float = Property(0.0, name="start-s")
    level: int = Property(0, readonly=True, doc="Set by the element.")
    twice: int = Property(0, read=lambda element: 2 * element.level)


def test_a_property_may_have_another_name_than_its_attribute() -> None:
    """Users use the name; `property_changed` and Python use the attribute."""
    element = Renamed()
    element.set_property("async", "no")
    element.set_property("start_s", 2)
    assert (element.is_async, element.first_s) == (False, 2.0)
    assert Renamed.properties["async"].kind is bool
    assert Renamed.properties["start_s"].spelling == "start-s"
    with pytest.raises(PropertyError, match=r"^renamed has no property 'is-async'"):
        element.set_property("is-async", "no")


def test_read_only_properties_are_not_set() -> None:
    """A warning is posted; the element itself sets the attribute or computes it."""
    element = Renamed()
    reported: list[Message] = []
    element.poster = reported.append
    element.set_property("level", 4)
    element.set_property("twice", 4)
    assert element.level == 0
    assert [message.text for message in reported] == [
        "property level can only be read; the value is ignored",
        "property twice can only be read; the value is ignored",
    ]
    element.level = 3
    assert element.twice == 6
    with pytest.raises(AttributeError, match=r"^property twice of Renamed can only be read$"):
        element.twice = 1


def test_an_integer_beyond_the_range_of_floats_is_refused() -> None:
    """With a `PropertyError`."""
    with pytest.raises(PropertyError, match="property gain cannot be"):
        Sample().set_property("gain", 10**400)


def test_the_refusal_of_a_secret_does_not_show_it() -> None:
    """Also where the rule contains the value."""

    class Vault(Element):
        word: str = Property("", secret=True)

    refusal = Vault.properties["word"].refusal("hunter2", "ValueError: bad hunter2", "x")
    assert "hunter2" not in str(refusal)


@pytest.mark.parametrize(
    ("annotation", "default", "rule"),
    [
        ("int", "3", "it must be int, as the annotation says, got '3'"),
        ("int", 1.5, "property value cannot be 1.5: it takes int"),
        ("float", "fast", "property value cannot be 'fast'"),
        ("bool", 1, "property value cannot be 1: it takes bool"),
        ("str", None, "property value cannot be None: it takes str"),
    ],
)
def test_a_default_of_the_wrong_type_is_refused_with_the_class(
    annotation: str, default: object, rule: str
) -> None:
    """Its author sees it when the module is imported, not when the element is used."""
    body = {"__annotations__": {"value": annotation}, "value": Property(default), "__module__": __name__}
    with pytest.raises(
        TypeError, match=re.escape(f"Wrong.value: the default does not fit the property: {rule}")
    ):
        type("Wrong", (Element,), body)


def test_a_default_out_of_range_is_refused_with_the_class() -> None:
    """So is one that no user could set."""
    with pytest.raises(TypeError, match=r"it takes float 0\.\.1"):
        type("Wrong", (Element,), {"value": Property(2.0, min=0, max=1), "__module__": __name__})


def test_a_class_without_annotations_may_declare_a_property() -> None:
    """The type is that of the default."""

    class Plain(Transform):
        fade = Property(0.9, doc="x")

    assert Plain.properties["fade"].kind is float


@pytest.mark.parametrize("base", [Source, Transform, Sink])
@pytest.mark.parametrize(
    ("attribute", "use"),
    [
        ("drops", "attribute Element.drops"),  # set on each element
        ("parent", "attribute Element.parent"),  # computed
        ("rank", "attribute Element.rank"),  # of the class
        ("properties", "attribute PropertyOwner.properties"),
        ("sink", "attribute PadOwner.sink"),
        ("stop", "method Element.stop"),
    ],
)
def test_a_property_does_not_hide_what_the_engine_uses(base: type, attribute: str, use: str) -> None:
    """The engine would read the value of the property, or the property that of the engine."""
    with pytest.raises(TypeError, match=rf"^Hiding.{attribute}: the property hides the {use}; rename it$"):
        type("Hiding", (base,), {attribute: Property(3, doc="x")})


@pytest.mark.parametrize("base", [Source, Transform, Sink, Combine, NumberedFilesSink, TextFileSink])
def test_each_attribute_that_the_engine_sets_is_reserved(base: type[Element]) -> None:
    """The list of names is written by hand."""
    element = type("Plain", (base,), {"sink": "ANY", "src": "ANY"})()
    declared = {declaration.attribute for declaration in element.properties.values()} | {NAME}
    public = {name for name in vars(element) if not name.startswith("_")} - declared
    assert {name for name in public if not use_of(type(element), name)} == set()


def test_a_property_is_not_called_name() -> None:
    """In a description that names the element, whatever the attribute is called."""
    for attribute, name in (("name", ""), ("title", "name")):
        with pytest.raises(TypeError, match='"name" names the element in a description; rename the prop'):
            type("Hiding", (Transform,), {attribute: Property("", name=name, doc="x")})


def test_a_property_may_have_the_name_of_a_plain_value() -> None:
    """As `is_live` of a source, and any name that the engine uses for something else only."""
    names = ("is_live", "items", "caps", "seq")
    properties = {name: Property(False, doc="x") for name in names}
    assert type("Free", (Source,), properties).properties.keys() >= set(names)
