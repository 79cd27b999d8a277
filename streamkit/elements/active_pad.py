"""The property active-pad of selectors: which names it takes."""

from __future__ import annotations

from streamkit.element.base import Element
from streamkit.errors import PropertyError


def demand_pad_name(element: Element, name: str | None, template: str) -> None:
    """Checks that `name` is a pad of the element, or can become one while the graph is being built.

    Raises:
        PropertyError: it cannot.
    """
    if name is None or name in element.pads:
        return
    if element.host is None and element.pad_templates[template].matches(name):
        return
    known = ", ".join(pad for pad in element.pads if element.pad_templates[template].matches(pad))
    raise PropertyError(
        f"{element.name}: property active-pad cannot be {name!r}: it takes the name of a pad"
        + (f" ({known})" if known else f" ({template.replace('%u', '0')}, ...)")
    )
