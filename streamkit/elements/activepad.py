"""The property active-pad of the selectors."""

from __future__ import annotations

from streamkit.element.base import Element
from streamkit.errors import PropertyError


def check_active_pad(element: Element, name: str | None, template_name: str) -> None:
    """Refuses a name that is not a pad; while the graph is built, one that cannot become a pad.

    Raises:
        PropertyError: with the names of the pads.
    """
    template = element.pad_templates[template_name]
    if name is None or name in element.pads or (element.host is None and template.matches(name)):
        return
    known = ", ".join(pad for pad in element.pads if template.matches(pad))
    known = known or template_name.replace("%u", "0, ...")
    raise PropertyError(
        f"{element.name}: property active-pad cannot be {name!r}: it takes the name of a pad ({known})"
    )
