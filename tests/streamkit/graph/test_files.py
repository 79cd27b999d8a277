"""Files of a graph: none is both read and written, or written twice."""

from pathlib import Path

import pytest

from streamkit import DescriptionError, ElementFailure, Pipeline, PropertyError
from streamkit.element.registry import make_element


@pytest.mark.parametrize(
    ("reads", "writes"),
    [
        ("a.mp4", "a.mp4"),
        ("a.mp4", "./b/../a.mp4"),
        ("a.mp4", "symbolic.mp4"),
        ("hard.mp4", "a.mp4"),
        ("file://{}/a.mp4", "a.mp4"),
        ("f-00001.mp4", "f-%05d.mp4"),
    ],
)
def test_an_input_is_never_an_output(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small_file: Path, reads: str, writes: str
) -> None:
    """By any name; the input stays as it is, and the error names both elements."""
    monkeypatch.chdir(tmp_path)
    text = "filesrc name=in location=${input} ! decode ! videofilesink name=out location=${output}"
    variables = {"input": reads.format(tmp_path), "output": writes}
    with pytest.raises(DescriptionError, match=r"out must not write .*: it is read by in") as failure:
        Pipeline.parse(text, variables)
    assert failure.value.code == "could-not-set-property"
    assert failure.value.place.column == text.index("videofilesink") + 1
    assert small_file.read_bytes() == b"flight"


@pytest.fixture
def small_file(tmp_path: Path) -> Path:
    """A file with a symbolic and a hard link, and a folder."""
    path = tmp_path / "a.mp4"
    path.write_bytes(b"flight")
    (tmp_path / "symbolic.mp4").symlink_to(path)
    (tmp_path / "hard.mp4").hardlink_to(path)
    (tmp_path / "b").mkdir()
    return path


def test_two_sinks_do_not_share_a_file(tmp_path: Path) -> None:
    """Also one that does not exist yet; a device may be shared."""
    text = "videotestsrc ! tee name=t  t. ! filesink location=${one}  t. ! filesink location=${other}"
    with pytest.raises(DescriptionError, match=r"filesink1 must not write .*: it is written by filesink0"):
        Pipeline.parse(text, {"one": f"{tmp_path}/x", "other": f"{tmp_path}/./x"})
    Pipeline.parse(text, {"one": "/dev/null", "other": "/dev/null"})


@pytest.mark.parametrize(
    ("one", "other", "is_refused"),
    [
        ("p%05d.bin", "p%05d.bin", True),
        ("p%05d.bin", "p%d.bin", True),
        ("p-%Y%m%dT%H%M%SZ.bin", "p-%Y%m%dT%H%M%SZ.bin", True),
        ("p%05d.bin", "q%05d.bin", False),
    ],
)
def test_two_sinks_do_not_share_numbered_files(
    tmp_path: Path, one: str, other: str, is_refused: bool
) -> None:
    """Each would replace the files of the other."""
    text = (
        f"videotestsrc ! tee name=t  t. ! multifilesink location={tmp_path}/{one} "
        f"t. ! multifilesink location={tmp_path}/{other}"
    )
    if not is_refused:
        Pipeline.parse(text)
        return
    with pytest.raises(DescriptionError, match=r"multifilesink1 must not write .*: it is written by"):
        Pipeline.parse(text)


def test_a_location_that_is_set_later_is_checked_at_the_start(tmp_path: Path) -> None:
    """By its ending, and against the others."""
    pipeline = Pipeline.parse(
        f"videotestsrc ! tee name=t  t. ! filesink location={tmp_path}/x  t. ! tracksink name=s"
    )
    for location, rule in (
        (f"{tmp_path}/x", "must end in"),
        (f"{tmp_path}/t.xml", r"must end in \.jsonl, \.txt"),
    ):
        pipeline["s"].location = location
        with pytest.raises(ElementFailure, match=rule):
            pipeline.ready()


def test_an_added_branch_is_checked(tmp_path: Path) -> None:
    """Against the files of the others."""
    pipeline = Pipeline.parse(f"videotestsrc ! tee name=t ! filesink location={tmp_path}/x")
    with pytest.raises(DescriptionError, match="must not write"):
        pipeline.add_branch("t", f"filesink location={tmp_path}/x")
    assert len(pipeline.graph.elements) == 3


@pytest.mark.parametrize("location", ["\0", "flight\0.mp4", "\ud800"])
@pytest.mark.parametrize("element", ["filesrc", "filesink"])
def test_what_cannot_be_a_file_name_is_refused(element: str, location: str) -> None:
    """NUL and half of a character end in an error of the property, by text and by value."""
    with pytest.raises(DescriptionError, match="location cannot be"):
        Pipeline.parse(f"{element} location={location}")
    with pytest.raises(PropertyError, match="location cannot be"):
        make_element(element).set_property("location", location)


def test_a_text_with_half_of_a_character_is_refused() -> None:
    """Python reads bytes of another encoding than the terminal's so; drawing them ended the process."""
    with pytest.raises(DescriptionError, match="half of a character"):
        Pipeline.parse("videotestsrc ! textoverlay text=Gr\udcfcn ! fakesink")
    overlay = make_element("textoverlay")
    with pytest.raises(PropertyError, match="half of a character"):
        overlay.set_property("text", "Gr\udcfcn")
    overlay.set_property("text", "Grün 😀")
    assert overlay.text == "Grün 😀"


def test_files_are_named_by_paths_too(tmp_path: Path) -> None:
    """As a program has them: a `Path` in a property or a variable, a number in a variable."""
    text = (
        "videotestsrc num-buffers=${count} ! tee name=t  t. ! filesink location=${one}  t. ! filesink name=f"
    )
    with Pipeline.parse(text, {"one": tmp_path / "one.raw", "count": 2}) as pipeline:
        pipeline["f"].location = tmp_path / "two.raw"
        pipeline.run(timeout_s=20)
    assert (tmp_path / "one.raw").read_bytes() == (tmp_path / "two.raw").read_bytes() != b""
    with pytest.raises(PropertyError, match="property key cannot be PosixPath"):
        make_element("zenohsrc").set_property("key", tmp_path)


def test_a_name_that_is_too_long_is_an_error_of_the_sink(tmp_path: Path, small_file: Path) -> None:
    """Whether it is that of the input is not known; the error is one line, at the start."""
    text = f"filesrc location={small_file} ! filesink location={tmp_path}/{'d' * 300}.raw"
    with pytest.raises(
        ElementFailure, match=r"^filesink0: location=.*: cannot be written: File name too long;"
    ):
        Pipeline.parse(text).run(timeout_s=10)
