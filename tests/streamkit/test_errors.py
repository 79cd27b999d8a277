"""Error texts."""

import errno
import os

import numpy as np
import pytest

from streamkit import Caps, ElementFailure, Frame, Pipeline, ResourceError, Source, write_remedy
from streamkit.errors import did_you_mean


@pytest.mark.parametrize("text", ["it is broken", "bad0: it is broken"])
def test_an_element_is_named_once(register, text: str) -> None:
    """Whether or not the error of the element names it already."""

    class Bad(Source):
        src = "a/b"

        def start(self) -> None:
            raise ResourceError(text)

    register(bad=Bad)
    with pytest.raises(ElementFailure) as failure:
        Pipeline.parse("bad ! fakesink").run(timeout_s=10)
    assert str(failure.value) == "bad0: it is broken"


@pytest.mark.parametrize(
    ("word", "meant"),
    [("locatoin", "location"), ("loc", "location"), ("pix", "pixel-format"), ("x", ""), ("speed", "")],
)
def test_a_suggestion_is_similar_or_begins_with_the_word(word: str, meant: str) -> None:
    """One letter, or a word like none, gets no suggestion."""
    hint = did_you_mean(word, ["location", "loop", "pixel-format", "x-offset"])
    assert hint == (f'did you mean "{meant}"?' if meant else "")


@pytest.mark.parametrize(
    ("number", "remedy"),
    [
        (errno.ENOSPC, "; free some space"),
        (errno.EDQUOT, "; free some space"),
        (
            errno.EFBIG,
            "; the limit of a file's size is reached (ulimit -f, or the file system's): write several files",
        ),
        (errno.EPIPE, "; what read it has ended"),
        (errno.EACCES, "; check that the directory is there and takes files"),
        (errno.EINVAL, ""),
    ],
)
def test_write_remedy_depends_on_the_cause(number: int, remedy: str) -> None:
    """Free space helps a full disk only."""
    assert write_remedy(OSError(number, os.strerror(number))) == remedy


def test_a_write_into_a_shared_frame_names_the_remedy() -> None:
    """The words of numpy name none."""
    pixels = np.zeros(1)
    pixels.flags.writeable = False
    with pytest.raises(ValueError, match="read-only") as caught:
        pixels[0] = 1
    assert str(ElementFailure("trail0", "trail", caught.value)) == (
        "trail0: ValueError: assignment destination is read-only: frames are shared, "
        "write into the copy of frame.writable()"
    )


def test_an_assignment_to_a_frame_names_the_remedy() -> None:
    """The words of msgspec name none."""
    frame = Frame(b"", Caps("a/b"))
    with pytest.raises(AttributeError) as caught:
        frame.pts = 3  # type: ignore[misc]
    assert str(ElementFailure("late0", "late", caught.value)).endswith(
        ": frames are shared, frame.replace(pts=...) gives a changed copy"
    )


def test_an_exception_without_words_is_named_once() -> None:
    """As of a bare `assert`."""
    assert str(ElementFailure("trail0", "trail", AssertionError())) == "trail0: AssertionError"
