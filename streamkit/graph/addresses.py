"""URIs in a description: selects the element that reads or writes one."""

from __future__ import annotations

import urllib.parse

from streamkit.element.registry import element_class, installed_elements
from streamkit.errors import DescriptionError, Place, PluginBroken
from streamkit.masking import mask_secrets

LOCAL_HOSTS = ("", "localhost")


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
    if plain in installed_elements():
        return plain
    found = max(_candidates(scheme, as_source=as_source), default=None)
    if found is None:
        raise DescriptionError(
            "no-such-element", f"no {kind} element for scheme {scheme!r}: {mask_secrets(url)}", place
        )
    return found[1]


def _candidates(scheme: str, *, as_source: bool) -> list[tuple[int, str]]:
    """Rank and name of every source or sink that declares a scheme; imports them."""
    found = []
    for name in installed_elements():
        if not name.endswith("src" if as_source else "sink"):
            continue
        try:
            known = element_class(name)
        except (PluginBroken, DescriptionError):
            continue
        if scheme in known.uri_schemes:
            found.append((known.rank, name))
    return found


def location_of(url: str, place: Place) -> str:
    """The `location` for a URI: the path of a local file, else the URI itself; raises `DescriptionError`."""
    scheme, _, rest = url.partition("://")
    if scheme.lower() != "file":
        return url
    host, slash, path = rest.partition("/")
    if host not in LOCAL_HOSTS:
        raise DescriptionError(
            "no-such-element", f"no element for files of the host {host!r}", place, f"write file:///{rest}"
        )
    return urllib.parse.unquote(slash + path)
