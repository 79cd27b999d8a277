"""URIs in a description: selects the element that reads or writes one."""

from __future__ import annotations

import contextlib
import urllib.parse

from streamkit.element.registry import available_elements, element_class
from streamkit.errors import DescriptionError, Place, PluginBroken
from streamkit.masking import mask_secrets


def factory_for(url: str, *, as_source: bool, place: Place) -> str:
    """The element type for a URI: named after its scheme and side, else the one of the highest rank.

    Raises:
        DescriptionError: code `no-such-element`.
    """
    kind = "source" if as_source else "sink"
    scheme, mark, _ = url.partition("://")
    if not mark:
        raise DescriptionError(
            "no-such-element", f"no {kind} element for the path {url!r}", place,
            "write file:///PATH, or filesrc location=PATH",
        )  # fmt: skip
    scheme = scheme.lower()
    plain = f"{scheme}{'src' if as_source else 'sink'}"
    if plain in available_elements():
        return plain
    found: list[tuple[int, str]] = []
    for name in available_elements():
        if name.endswith("src" if as_source else "sink"):
            with contextlib.suppress(PluginBroken, DescriptionError):
                known = element_class(name)
                found += [(known.rank, name)] if scheme in known.uri_schemes else []
    if not found:
        what = f"no {kind} element for scheme {scheme!r}: {mask_secrets(url)}"
        raise DescriptionError("no-such-element", what, place)
    return max(found)[1]


def location_of(url: str, place: Place) -> str:
    """The `location` for a URI: the path of a local file, else the URI itself; raises `DescriptionError`."""
    scheme, _, rest = url.partition("://")
    if scheme.lower() != "file":
        return url
    host, slash, path = rest.partition("/")
    if host not in ("", "localhost"):
        raise DescriptionError(
            "no-such-element", f"no element for files of the host {host!r}", place, f"write file:///{rest}"
        )
    return urllib.parse.unquote(slash + path)
