"""Error texts."""

import errno
import os

import pytest

from streamkit import ElementFailure, Pipeline, ResourceError, Source, write_remedy


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
    ("number", "remedy"),
    [
        (errno.ENOSPC, "; free some space"),
        (errno.EDQUOT, "; free some space"),
        (errno.EPIPE, "; what read it has ended"),
        (errno.EACCES, "; check that the directory is there and takes files"),
        (errno.EINVAL, ""),
    ],
)
def test_write_remedy_depends_on_the_cause(number: int, remedy: str) -> None:
    """Free space helps a full disk only."""
    assert write_remedy(OSError(number, os.strerror(number))) == remedy
