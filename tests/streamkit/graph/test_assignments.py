"""Properties, presets and names set by a description."""

from collections.abc import Callable

import pytest

from streamkit import Choice, Element, Property
from streamkit.errors import DescriptionError
from streamkit.graph.build import build

Register = Callable[..., None]


class Quality(Choice):
    """Has labels."""

    LOW = "low", 1, "Small files"
    HIGH = "high", 7, "Good pictures"


class Coder(Element):
    """Has presets."""

    sink = "ANY"
    presets = {"Fast Lane": {"quality": Quality.LOW, "speed": 9}, "bad": {"speed": 10}}  # noqa: RUF012
    quality: Quality = Property(Quality.HIGH)
    speed: int = Property(1, min=0, max=9)
    place: str | None = Property(None)
    label: str = Property("x")
    frames_coded: int = Property(0, readonly=True)


@pytest.mark.parametrize(
    "text",
    [
        r"coder @preset=Fast\ Lane speed=3",
        r"coder quality=high @preset=Fast\ Lane",
        r"coder speed=3 @preset=Fast\ Lane quality=7",
    ],
)
def test_a_preset_overrides_properties(register: Register, text: str) -> None:
    """s07: wherever it is written."""
    register(coder=Coder)
    assert build(text, {}).elements[0].properties_set() == {"quality": "low", "speed": 9}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("coder @preset=Fast", "coder has no preset 'Fast'; did you mean \"Fast Lane\"?"),
        ('coder @preset="bad"', "coder has no preset '\"bad\"'"),
        ("coder @preset= bad", "coder has no preset ' bad'"),
        ("coder @preset=bad", "coder0: property speed cannot be 10: it takes int 0..9"),
        ("queue @preset=bad", "queue has no presets"),
    ],
)
def test_invalid_presets(register: Register, text: str, message: str) -> None:
    """s01-s08: quotes and blanks belong to the name, as in gst-launch."""
    register(coder=Coder)
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert caught.value.code == "could-not-set-property"
    assert str(caught.value).startswith(message)


@pytest.mark.parametrize("value", ["high", "7", "0x7", '"Good pictures"'])
def test_a_choice_by_word_number_or_label(register: Register, value: str) -> None:
    """v17-v20: what is shown is the word."""
    register(coder=Coder)
    assert build(f"coder quality={value}", {}).elements[0].properties_set() == {"quality": "high"}


@pytest.mark.parametrize("value", ["HIGH", "High", "0", "2", "Quality.HIGH", '"good pictures"'])
def test_a_choice_is_case_sensitive(register: Register, value: str) -> None:
    """v19-v23."""
    register(coder=Coder)
    with pytest.raises(DescriptionError, match="it takes low, high"):
        build(f"coder quality={value}", {})


def test_null_strings(register: Register) -> None:
    """NULL is GStreamer's null string."""
    register(coder=Coder)
    coder = build("coder place=NULL label=NULL name=NULL", {}).elements[0]
    assert (coder.name, coder.properties_set()) == ("coder0", {"place": None, "label": ""})


def test_a_read_only_property_is_ignored_with_a_warning(register: Register) -> None:
    """v36: in the warnings of the graph."""
    register(coder=Coder)
    graph = build("coder frames-coded=3 speed=2", {})
    assert graph.elements[0].properties_set() == {"speed": 2}
    assert graph.warnings == [
        ("read-only-property", "coder0: frames-coded can only be read; the value is ignored"),
    ]  # fmt: skip


def test_a_value_of_the_wrong_type_for_a_read_only_property_is_refused(register: Register) -> None:
    """With the code of other wrong values."""
    register(coder=Coder)
    with pytest.raises(DescriptionError, match="frames-coded cannot be 'x'") as caught:
        build("coder frames-coded=x", {})
    assert caught.value.code == "could-not-set-property"


def test_single_quotes_are_kept_and_noted(register: Register) -> None:
    """gst-launch knows double ones only."""
    register(coder=Coder)
    graph = build("coder place='a b'", {})
    assert graph.elements[0].properties_set() == {"place": "'a b'"}
    assert [code for code, _ in graph.warnings] == ["quotes"]


@pytest.mark.parametrize("written", ['"two', '"', '"two"three'])
def test_a_quote_that_is_not_closed_is_noted(register: Register, written: str) -> None:
    """gst-launch makes it a part of the value."""
    register(coder=Coder)
    assert [code for code, _ in build(f"coder place={written}", {}).warnings] == ["quotes"]
    assert build(r'coder place="\"two\""', {}).warnings == []


def test_a_second_name_is_reported() -> None:
    """n04: the first counts."""
    graph = build("fakesrc name=a name=b ! fakesink", {})
    assert (graph.elements[0].name, [code for code, _ in graph.warnings]) == ("a", ["name-ignored"])


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ('queue name="x y"', "x y"),
        ("queue name='x'", "'x'"),
        (r"queue name=\"x\"", "x"),
        ("queue name=a.b", "a.b"),
        ("queue name=日本", "日本"),
        ("input-selector", "inputselector0"),
    ],
)
def test_names(text: str, name: str) -> None:
    """q31, q41: any text can be a name; automatic ones have no dashes."""
    assert build(text, {}).elements[0].name == name


@pytest.mark.parametrize(
    ("text", "is_refused"), [("speed=1", True), ("quality=low", True), ("label=x", False)]
)
def test_a_link_that_touches_a_value_is_explained(register: Register, text: str, is_refused: bool) -> None:
    """It is part of the value, as in gst-launch: a number refuses it, a text takes it in with a warning."""
    register(coder=Coder)
    remedy = "a '!' that touches a value is part of it, as in gst-launch: put blanks around it"
    if is_refused:
        with pytest.raises(DescriptionError, match="cannot be") as caught:
            build(f"coder {text}!fakesink", {})
        assert caught.value.hint == remedy
    else:
        warned = f"coder0: label takes in what follows it: {remedy}"
        assert build(f"coder {text}!fakesink", {}).warnings == [("attached-link", warned)]
        assert build('coder label=wow!1 place="x!fakesink"', {}).warnings == []
