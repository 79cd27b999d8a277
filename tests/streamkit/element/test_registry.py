"""The registry finds elements by entry point and imports them when they are used."""

import importlib.metadata
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from streamkit import Element, Frame, Pipeline, PropertyError, Transform, register_element
from streamkit.element.entries import PluginEntry
from streamkit.element.gstreamer_names import BY_NAME, ELEMENTS
from streamkit.element.registry import available_elements, element_class, make_element
from streamkit.errors import DescriptionError, PluginBroken

Register = Callable[..., None]


def test_our_own_elements_come_through_entry_points() -> None:
    """No element is built in: each has package, version and class."""
    entries = available_elements()
    assert {"queue", "tee", "identity", "fakesrc", "fakesink", "capsfilter", "appsrc", "appsink"} <= set(
        entries
    )
    queue = entries["queue"]
    assert (queue.package, queue.target) == ("streamkit", "streamkit.elements.queue:Queue")
    assert queue.version
    assert list(entries) == sorted(entries)


def test_an_entry_describes_its_origin(tmp_path: Path) -> None:
    """Element, class, package and version."""
    (tmp_path / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: some-package\nVersion: 1.2\n", encoding="utf-8"
    )
    distribution = importlib.metadata.Distribution.at(tmp_path)
    entry = PluginEntry("element", "framediff", "some.module:FrameDiff", distribution)
    assert entry.where == "element 'framediff' (some.module:FrameDiff, some-package 1.2)"


def test_no_package_replaces_an_element_silently(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Streamkit's own is used, with a note that names both packages; none wins between two others."""
    for package in ("abc-plugin", "xyz-plugin"):
        folder = tmp_path / f"{package.replace('-', '_')}-1.5.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.5\n")
        own = "fakesink = fractions:Fraction\n" if package == "abc-plugin" else ""
        (folder / "entry_points.txt").write_text(
            f"[streamkit.elements]\n{own}contested = streamkit.elements.identity:Identity\n"
        )
    monkeypatch.syspath_prepend(tmp_path)
    available_elements.cache_clear()
    element_class.cache_clear()
    try:
        assert available_elements()["fakesink"].package == "streamkit"
        (note,) = Pipeline.parse("fakesrc ! fakesink").graph.warnings
        assert re.fullmatch(
            "element 'fakesink' is in streamkit .*, and in abc-plugin 1.5; that of streamkit is used", note[1]
        )
        rule = "element 'contested' is in (abc|xyz)-plugin 1.5, and in (abc|xyz)-plugin 1.5; uninstall one"
        with pytest.raises(PluginBroken, match=rule):
            make_element("contested")
        assert not Pipeline.parse("fakesrc ! identity ! appsink").graph.warnings
    finally:
        available_elements.cache_clear()
        element_class.cache_clear()


def test_an_unknown_element_gets_a_suggestion() -> None:
    """The nearest name is offered; the code is for programs."""
    with pytest.raises(
        DescriptionError, match=re.escape('no element "fakesrcc"; did you mean "fakesrc"?')
    ) as caught:
        element_class("fakesrcc")
    assert caught.value.code == "no-such-element"


def test_names_of_gstreamer_lead_to_ours() -> None:
    """What a user of GStreamer types first says which element does its work."""
    with pytest.raises(DescriptionError, match=re.escape('no element "x264enc"; here: encode')):
        element_class("x264enc")
    for name in (
        "rtph264pay",
        "videobalance",
        "pngenc",
        "nvv4l2decoder",
        "klvparse",
        "audiotestsrc",
        "tcpserversrc",
        "deinterlace",
        "rawvideoparse",
        "v4l2sink",
    ):
        with pytest.raises(DescriptionError, match=f'no element "{name}"; here: '):
            element_class(name)
    with pytest.raises(DescriptionError, match=r"gst-launch-1\.0 libcamerasrc !"):
        element_class("libcamerasrc")
    known = available_elements().keys() | {"nothing", "no"}  # "nothing is needed", "no window"
    assert {re.split("[ ,;]", words)[0] for words in ELEMENTS} <= known
    assert not BY_NAME.keys() & available_elements().keys()


def test_elements_are_made_with_name_and_properties() -> None:
    """The factory is the name it was asked by."""
    element = make_element("queue", "q", max_size_buffers=3)
    assert (element.name, element.factory, element.max_size_buffers) == ("q", "queue", 3)  # type: ignore[attr-defined]
    assert make_element("identity").name == "identity"
    with pytest.raises(PropertyError, match="queue has no property 'size'"):
        make_element("queue", size=3)


@pytest.mark.parametrize(
    ("target", "cause"),
    [
        ("no_such_module:Thing", "ModuleNotFoundError: No module named 'no_such_module'"),
        (
            "streamkit.elements.queue:NoClass",
            "AttributeError: module 'streamkit.elements.queue' has no attribute 'NoClass'",
        ),
        ("streamkit.elements.queue", "AttributeError: "),
    ],
)
def test_an_entry_point_that_cannot_be_loaded(register: Register, target: str, cause: str) -> None:
    """The error names element, class, package, cause and remedy, and keeps the exception."""
    register(halfbaked=target)
    message = (
        rf"^element 'halfbaked' \({re.escape(target)}, unknown package .*\) cannot be loaded: "
        rf"{re.escape(cause)}.*; reinstall or update unknown package, or tell its author$"
    )
    with pytest.raises(PluginBroken, match=message) as caught:
        make_element("halfbaked")
    assert caught.value.__cause__ is not None
    assert make_element("identity").factory == "identity"


def test_a_syntax_error_of_a_plugin_has_its_place(
    register: Register, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """File, line, column and text, as an author at work needs them."""
    path = tmp_path / "unfinished.py"
    path.write_text("class Blur:\n    gain = (1\n    end = 2\n")
    monkeypatch.syspath_prepend(tmp_path)
    register(blur="unfinished:Blur")
    with pytest.raises(PluginBroken, match=rf"SyntaxError: .* \({re.escape(str(path))}:2:12: gain = \(1\)"):
        make_element("blur")


def test_an_entry_point_must_be_an_element(register: Register) -> None:
    """Another class is refused with the rule and what it is."""
    register(notelement="fractions:Fraction")
    with pytest.raises(
        PluginBroken, match=r"must be a subclass of streamkit.Element, got <class 'fractions.Fraction'>"
    ):
        make_element("notelement")


def test_an_element_that_cannot_be_made_is_broken(register: Register) -> None:
    """A constructor that raises is the plugin's fault, and named as such."""

    class Stillborn(Element):
        """Cannot be made."""

        def __init__(self, name: str = "") -> None:
            raise ZeroDivisionError("no model file")

    register(stillborn=Stillborn)
    with pytest.raises(
        PluginBroken, match=r"^element 'stillborn' .* cannot be made: ZeroDivisionError: no model file; "
    ):
        make_element("stillborn")


def test_the_first_of_two_elements_with_one_name_is_used(register: Register) -> None:
    """A second package cannot replace an element."""
    register(twice="first:Thing")
    register(twice="second:Thing")
    assert available_elements()["twice"].target == "first:Thing"


def inverting(sign: int) -> type[Transform]:
    """A class as a cell of a notebook defines it."""

    class Invert(Transform):
        sink = src = "video/x-raw, format=GRAY8"

        def transform(self, frame: Frame) -> Frame:
            return frame.replace(data=255 - frame.data if sign < 0 else frame.data)

    return Invert


@pytest.mark.usefixtures("forget_registered")
def test_a_class_is_registered_without_a_package() -> None:
    """Under its own name or another; the last class of a name counts."""
    assert register_element(inverting(-1)) is element_class("invert")
    again = register_element(inverting(1))
    register_element(again, "plain")
    for name in ("invert", "plain"):
        with Pipeline.parse(f"videotestsrc num-buffers=2 ! {name} ! appsink name=out") as pipeline:
            assert isinstance(pipeline[f"{name}0"], again)
            pipeline.play()
            assert len(list(pipeline["out"])) == 2
    with pytest.raises(DescriptionError, match='no element "inver"; did you mean "invert"'):
        make_element("inver")


@pytest.mark.usefixtures("forget_registered")
def test_what_cannot_be_registered() -> None:
    """No other class, no installed or unwritable name; and a process of its own needs a package."""
    with pytest.raises(TypeError, match=r"got 'x'; write register_element\(CLASS, \"x\"\)"):
        register_element("x")  # type: ignore[type-var]
    with pytest.raises(TypeError, match=r"takes a subclass of streamkit\.Element, got <class 'int'>"):
        register_element(int)  # type: ignore[type-var]
    with pytest.raises(ValueError, match=r"element 'queue' .* is installed; register Invert by another name"):
        register_element(inverting(1), "queue")
    for name in ("my filter", "größe", "a/b", "-a"):
        with pytest.raises(ValueError, match=rf"got '{name}'; write register_element\(Invert, \"NAME\"\)"):
            register_element(inverting(1), name)
    register_element(inverting(1))
    with pytest.raises(DescriptionError, match="no other process can import it; omit process=true") as caught:
        Pipeline.parse("videotestsrc ! ( process=true videoscale ) ! invert ! fakesink")
    assert caught.value.place.column == 46


@pytest.mark.usefixtures("forget_registered")
@pytest.mark.parametrize("is_called", [False, True])
def test_a_constructor_that_does_not_pass_the_name_is_explained(is_called: bool) -> None:
    """It ended in a traceback, or in elements that all have the same name."""

    class Forgetful(inverting(1)):  # type: ignore[misc]
        def __init__(self, name: str, **properties: object) -> None:
            if is_called:
                super().__init__()

    register_element(Forgetful)
    with pytest.raises(
        DescriptionError, match=r"pass them to super\(\).__init__; to set up state, write start"
    ):
        Pipeline.parse("videotestsrc ! forgetful ! fakesink")


@pytest.mark.usefixtures("forget_registered")
def test_a_constructor_without_a_name_is_explained() -> None:
    """Authors write `__init__` for state, as everywhere else in Python."""

    class Stateful(inverting(1)):  # type: ignore[misc]
        def __init__(self) -> None:
            self.count = 0

    register_element(Stateful)
    with pytest.raises(DescriptionError, match=r"its __init__ must take name .* write start in its place"):
        Pipeline.parse("videotestsrc ! stateful ! fakesink")
