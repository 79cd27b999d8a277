"""URIs: the element that reads or writes one."""

from collections.abc import Callable

import pytest

from streamkit import Property, Sink, Source
from streamkit.errors import DescriptionError
from streamkit.graph.build import build

Register = Callable[..., None]


class Reader(Source):
    """Reads a location."""

    src = "ANY"
    location: str = Property("")


class Writer(Sink):
    """Writes a location."""

    location: str = Property("")
    sink = "ANY"


class Web(Reader):
    """Takes two schemes."""

    uri_schemes = ("http", "https")
    rank = 1


class BetterWeb(Web):
    """Goes before."""

    rank = 2


class Upload(Writer):
    """Writes to the same scheme."""

    uri_schemes = ("http",)


@pytest.mark.parametrize(
    ("text", "factory", "location"),
    [
        ("file:///a%20b/c ! fakesink", "filesrc", "/a b/c"),
        ("FILE://localhost/x ! fakesink", "filesrc", "/x"),
        ("fakesrc ! file:///x", "filesink", "/x"),
        (r"file:///a\ b ! fakesink", "filesrc", "/a b"),
        ("file:///x", "filesrc", "/x"),
        ("http://h/a%20b ! fakesink", "betterwebsrc", "http://h/a%20b"),
        ("https://h ! fakesink", "betterwebsrc", "https://h"),
        ("fakesrc ! http://h/x", "uploadsink", "http://h/x"),
        ("gopher://h/x ! fakesink", "gophersrc", "gopher://h/x"),
    ],
)
def test_the_element_for_an_address(register: Register, text: str, factory: str, location: str) -> None:
    """Named after scheme and side, else of the highest rank; files get their decoded path."""
    register(
        filesrc=Reader,
        filesink=Writer,
        websrc=Web,
        betterwebsrc=BetterWeb,
        uploadsink=Upload,
        gophersrc=Reader,
    )
    found = {element.factory: element.properties_set() for element in build(text, {}).elements}
    assert found[factory] == {"location": location}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nosuch://x ! fakesink", "no source element for scheme 'nosuch': nosuch://x"),
        ("fakesrc ! nosuch://me:pw@x", "no sink element for scheme 'nosuch': nosuch://***@x"),
        ("./a ! fakesink", "no source element for the path './a'; write file:///PATH"),
        ("/a ! fakesink", "no source element for the path '/a'; write file:///PATH"),
        ("file://host/a ! fakesink", "no element for files of the host 'host'; write file:///host/a"),
    ],
)
def test_a_uri_without_an_element_is_an_error(text: str, message: str) -> None:
    """u05-u07: code `no-such-element`; passwords are masked."""
    with pytest.raises(DescriptionError) as caught:
        build(text, {})
    assert caught.value.code == "no-such-element"
    assert str(caught.value).startswith(message)
