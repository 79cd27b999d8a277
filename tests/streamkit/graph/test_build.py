"""Graphs from descriptions: names, properties, bins, URIs and errors."""

import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from streamkit import Caps, Element, Pipeline, Property, PropertyError, Source, Transform
from streamkit.errors import DescriptionError, ElementFailure
from streamkit.graph.build import build

Register = Callable[..., None]
CODES = {
    "syntax", "no-such-element", "no-such-property", "link", "could-not-set-property", "empty-bin", "empty",
}  # fmt: skip


def names(text: str) -> list[str]:
    """The names of all elements, in order."""
    return [element.name for element in build(text, {}).elements]


def links(text: str) -> set[str]:
    """All links as words."""
    return {f"{src.path} -> {sink.path}" for src, sink in build(text, {}).links()}


def test_names_given_automatically_count_per_type() -> None:
    """GStreamer's: type and number, in textual order; a filter is an element named when its link is made."""
    text = "fakesrc ! a/b ! queue ! identity name=i ! queue ! c/d ! fakesink"
    with pytest.raises(DescriptionError):
        build(text, {})
    assert names("fakesrc ! a/b ! queue ! identity name=i ! queue ! fakesink fakesrc ! fakesink") == [
        "fakesrc0", "queue0", "i", "queue1", "fakesink0", "fakesrc1", "fakesink1", "capsfilter0",
    ]  # fmt: skip


def test_a_filter_is_linked_between_its_neighbours() -> None:
    """It has the caps of the text, escapes resolved."""
    graph = build(r'fakesrc ! a/b, s=(string)"x\!y" ! fakesink', {})
    assert graph.element("capsfilter0").properties_set() == {"caps": r'a/b, s=(string)"x\!y"'}
    assert {f"{src.path} -> {sink.path}" for src, sink in graph.links()} == {
        "fakesrc0.src -> capsfilter0.sink", "capsfilter0.src -> fakesink0.sink",
    }  # fmt: skip


def test_a_reference_may_come_before_its_element() -> None:
    """Links are made when all names are known."""
    assert links("a. ! fakesink  fakesrc ! identity name=a") == {
        "fakesrc0.src -> a.sink",
        "a.src -> fakesink0.sink",
    }


def test_automatic_names_can_be_referenced() -> None:
    """r21: identity0 is a name like another."""
    assert "identity0.src -> fakesink0.sink" in links("fakesrc ! identity  identity0. ! fakesink")


def test_the_first_name_and_the_last_value_win() -> None:
    """n04, v30: as gst-launch has it."""
    graph = build("queue name=a name=b max-size-buffers=1 max-size-buffers=2", {})
    assert graph.elements[0].name == "a"
    assert graph.elements[0].properties_set() == {"max-size-buffers": 2}


def test_settings_are_those_of_the_text_only() -> None:
    """Defaults are not repeated; values are JSON values, names have dashes."""
    (element,) = build("queue leaky=1 max_size_time=0x10", {}).elements
    assert element.properties_set() == {"leaky": "upstream", "max-size-time": 16}


def test_variables_are_filled_in() -> None:
    """A value with blanks stays one value."""
    graph = build("fakesrc num-buffers=${N:-3} ! identity name=${NAME} ! fakesink", {"NAME": "x"})
    assert graph.elements[0].properties_set() == {"num-buffers": 3}
    assert graph.elements[1].name == "x"


class Texts(Element):
    """Properties of texts, and one that refuses in its own way."""

    sink = "ANY"
    text: str = Property("")
    secret: str = Property("", secret=True)
    picky: int = Property(0)

    def property_changed(self, name: str) -> None:
        if name == "picky":
            raise ZeroDivisionError("no such device")


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("plain", "plain"),
        ('"a b"', "a b"),
        (r"\"x\"", "x"),
        (r'"\"x y\""', "x y"),
        (r'"C:\\dir"', r"C:\dir"),
        (r"t\303t", "t303t"),
        ('""', ""),
        ("'x", "'x"),
    ],
)
def test_texts_are_unquoted_twice(register: Register, written: str, value: str) -> None:
    """q30, q39: once as the launch line has it, once as a string value."""
    register(texts=Texts)
    element = build(f"texts text={written}", {}).elements[0]
    assert element.properties_set() == {"text": value}


def test_bins_group_elements() -> None:
    """Each element and bin knows the bin it stands in; links go through."""
    graph = build("fakesrc ! ( name=outer identity ! bin.( queue ! identity name=inner ) ) ! fakesink", {})
    assert [(group.name, group.factory, group.parent) for group in graph.bins] == [
        ("bin0", "bin", "outer"), ("outer", "bin", ""),
    ]  # fmt: skip
    assert {element.name: element.parent for element in graph.elements} == {
        "fakesrc0": "", "identity0": "outer", "queue0": "bin0", "inner": "bin0", "fakesink0": "",
    }  # fmt: skip
    assert [group.ghost_pads for group in graph.bins] == [
        {"ghost0": "queue0.sink", "ghost2": "inner.src"},
        {"ghost1": "identity0.sink", "ghost3": "bin0.ghost2"},
    ]
    assert {f"{src.path} -> {sink.path}" for src, sink in graph.links()} == {
        "fakesrc0.src -> identity0.sink", "identity0.src -> queue0.sink", "queue0.src -> inner.sink",
        "inner.src -> fakesink0.sink",
    }  # fmt: skip


def test_a_bin_is_linked_by_its_last_chain() -> None:
    """b29: outer links mean the first element of the first chain, the last of the last chain."""
    assert links("( fakesrc name=a fakesrc name=b ) ! fakesink") == {"b.src -> fakesink0.sink"}


def test_a_bin_may_set_properties_of_its_children() -> None:
    """Child properties are written `child::property`."""
    graph = build("bin.( s::num-buffers=3 fakesrc name=s )", {})
    assert graph.element("s").properties_set() == {"num-buffers": 3}


def test_an_address_is_a_source_or_a_sink(register: Register) -> None:
    """The element named after scheme and side; percent escapes of files are decoded."""

    class Fetch(Source):
        """A source with a place."""

        src = "ANY"
        location: str = Property("")

    register(filesrc=Fetch, httpsrc=Fetch)
    assert build("http://h/a%20b ! fakesink", {}).elements[0].properties_set() == {
        "location": "http://h/a%20b"
    }
    with pytest.raises(DescriptionError, match="no sink element for scheme 'gopher'"):
        build("fakesrc ! gopher://x", {})
    with pytest.raises(DescriptionError, match=r"no source element for the path './a'; write file:///PATH"):
        build("./a ! fakesink", {})


def test_backslashes_of_an_address_are_resolved(register: Register) -> None:
    """As in a value: a blank may stand behind one."""

    class Fetch(Source):
        """A source with a place."""

        src = "ANY"
        location: str = Property("")

    register(xsrc=Fetch)
    assert build(r"x://h/a\ b\"c ! fakesink", {}).elements[0].properties_set() == {"location": 'x://h/a b"c'}


@pytest.mark.parametrize(
    ("text", "code", "message", "column", "length"),
    [
        ("videodecod ! fakesink", "no-such-element", 'no element "videodecod"', 1, 10),
        ("fakesrc ! queu", "no-such-element", 'no element "queu"; did you mean "queue"?', 11, 4),
        ("queue max-size=3", "no-such-property", "queue has no property 'max-size'", 7, 10),
        ("queue leaky=Downstream", "could-not-set-property",
         "queue0: property leaky cannot be 'Downstream': it takes no, upstream, downstream; "
         'did you mean "downstream"?', 7, 16),
        ("fakesrc num-buffers=-5", "could-not-set-property",
         "fakesrc0: property num-buffers cannot be -5: it takes int -1..", 9, 14),
        ("capsfilter caps=a/b,,", "could-not-set-property",
         "capsfilter0: property caps cannot be 'a/b,,': caps 'a/b,,', at character 4", 12, 10),
        ("fakesrc ! a/b,x=[2,1] ! fakesink", "link",
         "could not parse caps 'a/b,x=[2,1]': a range's low end", 17, 5),
        ("fakesrc name=a ! fakesink name=a", "link", "two elements are named 'a'; names are unique", 18, 8),
        ("nosuch. ! fakesink", "no-such-element", "no element named 'nosuch' in the pipeline", 1, 7),
        ("tee name=tee1 tee2. ! fakesink", "no-such-element",
         "no element named 'tee2' in the pipeline; did you mean \"tee1\"?", 15, 5),
        ("( )", "empty-bin", "a bin holds at least one element", 1, 1),
        ("bim.( fakesrc )", "no-such-element", 'no bin "bim"; did you mean "bin"?', 1, 5),
        (
            "capture.( fakesrc )", "no-such-element",
            'no bin "capture"; for a bin of this name write "bin.( name=capture ... )"', 1, 9,
        ),
        ("( colour=red fakesrc )", "no-such-property", "bin has no property 'colour'", 3, 10),
        ("identity @preset=x", "could-not-set-property", "identity has no presets", 10, 9),
        ("", "empty", "the description is empty", 1, 1),
        ("( " * 70 + "queue" + " )" * 70, "syntax", "bins nest at most 64 deep", 129, 1),
    ],
)  # fmt: skip
def test_invalid_descriptions(text: str, code: str, message: str, column: int, length: int) -> None:
    """Code, message and place."""
    with pytest.raises(DescriptionError, match=f"^{re.escape(message)}") as caught:
        build(text, {})
    assert caught.value.code == code
    assert (caught.value.place.column, caught.value.place.length) == (column, length or 1)


class Reads(Source):
    """Reads a file."""

    src = "a/b"
    location: str = Property("", file="read", doc="File.")


@pytest.mark.parametrize("text", ["flight.mp4", "flight.mp4 ! fakesink"])
def test_the_name_of_a_file_is_answered_with_its_source(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a program that plays files takes it; it reads as a pad of an element."""
    monkeypatch.chdir(tmp_path)
    file = text.partition(" ")[0]
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert "filesrc" not in caught.value.hint
    (tmp_path / file).touch()
    with pytest.raises(DescriptionError, match=f"filesrc location={file} reads the file"):
        build(text, {})


@pytest.mark.parametrize(
    ("name", "said", "shown"),
    [
        ("my flight.mp4", "unexpected reference 'flight'", "my flight.mp4"),
        ("my flight (1).mp4", 'no element "flight"', "my flight"),
    ],
)
def test_the_name_of_a_file_with_a_blank_is_answered_with_quotes(
    tmp_path: Path, register: Register, name: str, said: str, shown: str
) -> None:
    """What follows the blank reads as another element; without such a file nothing is guessed."""
    register(reads=Reads)
    text = f"reads location={tmp_path}/{name} ! fakesink"
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert "quotes" not in caught.value.hint
    (tmp_path / name).touch()
    rule = f'{said}; a value with a blank stands in quotes, location="{tmp_path}/{shown}..."'
    with pytest.raises(DescriptionError, match=f"^{re.escape(rule)}$"):
        build(text, {})


def test_the_caret_is_below_the_error() -> None:
    """The example of the documentation."""
    text = "# a flight\nfakesrc\n    ! queu ! fakesink"
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert caught.value.pointed(text, "pipelines/track.pipe") == (
        'pipelines/track.pipe:3:7: no element "queu"; did you mean "queue"?\n'
        "        ! queu ! fakesink\n"
        "          ^^^^"
    )


def test_any_exception_of_a_property_is_a_description_error(register: Register) -> None:
    """With its cause."""
    register(texts=Texts)
    with pytest.raises(
        DescriptionError, match=r"^texts0: property picky cannot be '3': ZeroDivisionError: no such device$"
    ) as caught:
        build("texts picky=3", {})
    assert caught.value.code == "could-not-set-property"


def test_secrets_are_masked_in_the_graph(register: Register) -> None:
    """What is exported shows that a secret is set, not what it is."""
    register(texts=Texts)
    (element,) = build("texts secret=hunter2", {}).elements
    assert element.properties_set() == {"secret": "***"}
    assert element.secret == "hunter2"  # type: ignore[attr-defined]


@pytest.mark.parametrize("text", ["halfbaked ! fakesink", "halfbaked://x ! fakesink"])
def test_a_broken_plugin_points_into_the_text(register: Register, text: str) -> None:
    """Its use is an error of this description only; the cause is named."""
    register(halfbaked="no_such_module:Thing", halfbakedsrc="no_such_module:Thing")
    with pytest.raises(
        DescriptionError, match="cannot be loaded: ModuleNotFoundError: No module named 'no_such_module'"
    ) as caught:
        build(text, {})
    assert caught.value.code == "plugin-broken"
    assert caught.value.place.column == 1
    assert build("fakesrc ! fakesink", {}).elements


@pytest.mark.parametrize(
    "text",
    [
        "fakesrc ! video/x-raw ! video/x-raw, width=8 ! fakesink",
        "video/x-raw ! fakesink",
        "fakesrc ! video/x-raw",
    ],
)
def test_caps_where_an_element_must_stand_are_noticed(text: str) -> None:
    """The name of an element like the first word of the caps would be no help."""
    with pytest.raises(
        DescriptionError, match=r'^no element "video"; a caps filter stands alone, between two elements$'
    ):
        build(text, {})


def test_a_file_in_a_folder_is_no_caps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Who leaves out filesrc hears of it."""
    (tmp_path / "clips").mkdir()
    (tmp_path / "clips" / "a.mp4").touch()
    monkeypatch.chdir(tmp_path)
    with pytest.raises(
        DescriptionError, match=r'^no element "clips"; filesrc location=clips/a.mp4 reads the file$'
    ):
        build("clips/a.mp4 ! decode ! fakesink", {})


def test_caps_at_the_end_of_a_bin_have_a_remedy() -> None:
    """The bracket is taken for a part of the caps."""
    with pytest.raises(DescriptionError, match=r"; at the end of a bin, write capsfilter caps=\.\.\.$"):
        build("( fakesrc ! video/x-raw, width=8 ) ! fakesink", {})


def test_a_property_without_a_value_is_noticed() -> None:
    """As of a shell variable that is not set: the next word is its value, as in gst-launch."""
    with pytest.raises(DescriptionError, match=r'no element "location"; location= has no value; write one'):
        build("videotestsrc ! filesink location=", {})
    with pytest.raises(DescriptionError, match=r'no element "location"$'):
        build("videotestsrc ! location", {})
    (warning,) = build("filesrc location= ! decode ! fakesink", {}).warnings
    assert warning[0] == "no-value"
    assert warning[1].startswith('filesrc0: location has no value and takes the next word, "!"')


def test_a_plugin_that_fails_on_import_shows_its_line(
    register: Register, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that its author finds it; where a library raises, the line that calls it."""
    path = tmp_path / "halfway.py"
    path.write_text("import fractions\n\nfractions.Fraction(1, 0)\n")
    monkeypatch.syspath_prepend(tmp_path)
    register(blur="halfway:Blur")
    with pytest.raises(DescriptionError, match="ZeroDivisionError") as caught:
        build("fakesrc ! blur ! fakesink", {})
    assert caught.value.hint == f"raised at {path}:3"


@pytest.mark.parametrize("method", ["transform_caps", "query_caps"])
def test_an_element_that_raises_when_asked_for_caps_is_named(register: Register, method: str) -> None:
    """With its place in the text, as other errors of a description."""

    def fail(*_: object) -> Caps:
        raise ValueError("no such table")

    register(picky=type("Picky", (Transform,), {"sink": "a/b", "src": "a/b", method: fail}))
    with pytest.raises(DescriptionError, match="picky0: ValueError: no such table") as caught:
        build("fakesrc ! picky ! fakesink", {})
    assert (caught.value.code, caught.value.place.column) == ("plugin-broken", 11)
    assert caught.value.hint.startswith("raised at test_build.py:")


def test_an_unknown_element_of_a_graph_lists_those_there() -> None:
    """`pipeline["x"]` says what there is instead."""
    with pytest.raises(KeyError, match="no element 'x' in the pipeline; it has fakesrc0, fakesink0"):
        build("fakesrc ! fakesink", {}).element("x")


def test_caps_and_properties_may_be_set_later() -> None:
    """The elements of a graph are ordinary objects."""
    graph = build("fakesrc ! capsfilter ! fakesink", {})
    graph.element("capsfilter0").set_property("caps", Caps("a/b"))
    with pytest.raises(PropertyError):
        graph.element("fakesrc0").set_property("nosuch", 1)


pieces = st.sampled_from(
    ["fakesrc", "queue", "tee", "fakesink", "funnel", "name=t", "name=b", "t.", "t.src_1", "b.", ".sink", "!",
     "!", "!", "!", ":", "(", ")", "bin.(", "pipeline.( name=b", "x::y=1", "t::num-buffers=1", 'name="x y"',
     ",", ";", "! a/b, x={1,2} !", ": video/x-raw !", "file:///x", "@preset=p", "leaky=1", "leaky=x", "ü",
     "${X:-queue}", "capsfilter caps=a/b", "identity", "\n# c\n", "nosuch", "bin", "input-selector", ".src_0"]
)  # fmt: skip


@given(st.lists(pieces, max_size=25).map(" ".join) | st.text(max_size=60))
@settings(max_examples=300)
def test_any_text_is_a_graph_or_a_description_error(text: str) -> None:
    """Nothing else is raised, and in a graph every link has two ends that know each other."""
    try:
        graph = build(text, {})
    except DescriptionError as error:
        if error.code not in CODES:
            raise
        return
    for src, sink in graph.links():
        assert src.peer is sink
        assert sink.peer is src
        assert src.element in graph.elements
        assert sink.element in graph.elements


@pytest.mark.parametrize(
    "text",
    [
        "fakesrc ! " + "identity ! " * 998 + "fakesink",
        "tee name=t " + "t. ! queue ! fakesink " * 300,
        "fakesrc name=a0 " + " ".join(f"a{n}. ! identity name=a{n + 1}" for n in range(300)),
        "( " * 60 + "fakesrc" + " )" * 60 + " ! fakesink",
        "identity " * 2_000,
    ],
)
def test_large_graphs_are_built_quickly(text: str) -> None:
    """The time grows with the text, not with its square."""
    begun = time.process_time()
    assert build(text, {}).elements
    assert time.process_time() - begun < 15.0


def test_twice_the_elements_cost_twice_as_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """Elements of a chain are not compared pairwise."""
    looks: list[str] = []
    src_pads = Element.src_pads
    monkeypatch.setattr(Element, "src_pads", lambda self: looks.append(self.name) or src_pads(self))
    counts = []
    for number in (100, 200):
        build("fakesrc ! " + "identity ! " * number + "fakesink", {})
        counts.append(len(looks))
        looks.clear()
    assert counts[1] < 2.2 * counts[0]


def test_a_misspelt_field_of_a_filter_is_noted() -> None:
    """It would restrict nothing; fields that are like none of raw video's are the user's own."""
    graph = build("fakesrc ! video/x-raw, widht=320, scene=3 ! fakesink", {})
    assert graph.warnings == [("unknown-field", 'video/x-raw has no field widht; did you mean "width"?')]
    graph = build("fakesrc ! video/x-raw, framerate=25 ! fakesink", {})
    assert graph.warnings == [("unknown-field", "framerate is a fraction; write framerate=25/1")]
    with pytest.raises(DescriptionError, match="framerate is a fraction") as caught:
        build("videotestsrc ! video/x-raw, framerate=25 ! fakesink", {})
    assert caught.value.hint == "framerate is a fraction; write framerate=25/1"


@pytest.mark.parametrize(
    ("caps", "hint"),
    [
        ("format=GREY8", 'no element of streamkit has the format GREY8; did you mean "GRAY8"?'),
        ("framerate=5.5", "framerate is a fraction; write framerate=11/2"),
        ("framerate=23.976", "framerate is a fraction; write framerate=24000/1001"),
    ],
)
def test_caps_that_nothing_has_get_a_hint(caps: str, hint: str) -> None:
    """In the error of the link."""
    with pytest.raises(DescriptionError) as caught:
        build(f"videotestsrc ! video/x-raw, {caps} ! fakesink", {})
    assert caught.value.hint == hint


def test_a_misspelt_attribute_is_refused_before_the_start() -> None:
    """Python takes any attribute; other ones than misspelt properties stay the program's own."""
    with Pipeline.parse("fakesrc name=s num-buffers=1 ! fakesink") as pipeline:
        pipeline["s"].note = "mine"
        pipeline["s"].num_bufers = 2
        with pytest.raises(
            ElementFailure, match=r"^s \(fakesrc\): no property 'num_bufers'; did you mean \"num_buffers\"\?"
        ):
            pipeline.play()
        del pipeline["s"].num_bufers
        pipeline.run(timeout_s=20)


def test_an_element_downstream_of_one_that_uses_its_metadata_is_noted() -> None:
    """Whatever stands between; not in another branch, and not in the right order."""
    text = "videotestsrc ! framediff ! queue ! stitch ! fakesink"
    what = "framediff0 does not get what stitch0 measures: put stitch0 before it"
    assert build(text, {}).warnings == [("order", what)]
    for fine in (
        "videotestsrc ! stitch ! framediff ! fakesink",
        "videotestsrc ! framediff motion=own ! stitch ! fakesink",
        "videotestsrc ! tee name=t ! framediff ! fakesink t. ! stitch ! fakesink",
    ):
        assert not build(fine, {}).warnings
