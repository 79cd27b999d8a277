"""Selection among caps of raw video."""

from __future__ import annotations

from streamkit import Caps, NotNegotiated, ValueList
from streamkit_video.pixel_formats import odd_size_error, supports_size


def formats_in(caps: Caps) -> list[str]:
    """The pixel formats of caps, in their order."""
    found: list[str] = []
    for structure in caps.structures:
        value = structure.fields.get("format")
        items = value.items if isinstance(value, ValueList) else (value,)
        found.extend(item for item in items if isinstance(item, str) and item not in found)
    return found


def choose_format(allowed: Caps, near: Caps, element: str, wanted: tuple[str, ...] = ()) -> Caps:
    """Fixed caps out of `allowed`, of the first wanted format that its size allows.

    Args:
        allowed: raw video caps.
        near: preferred values of the other fields.
        element: name for the error.
        wanted: formats in order of preference; the order of `allowed` if empty.

    Raises:
        NotNegotiated: only I420 or NV12 of an odd size is left.
    """
    refused = ""
    for name in wanted or formats_in(allowed):
        caps = (allowed & Caps(f"video/x-raw, format={name}")).fixate(near=near)
        if caps.is_empty:
            continue
        size = (caps.integer("width"), caps.integer("height"))
        if supports_size(name, *size):
            return caps
        refused = refused or odd_size_error(name, *size)
    raise NotNegotiated(f"{element}: {refused or f'caps {allowed} name no format of raw video it knows'}")
