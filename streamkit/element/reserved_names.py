"""Names that the base classes of elements use for themselves, and that a property must not have."""

from __future__ import annotations

import inspect

NAME = "name"  # in a description it names the element
# By class, the public attributes that it declares for its subclasses to set, or sets on each element.
ATTRIBUTES = {
    "PropertyOwner": {"defaults", "is_playing", "properties", "set_in_text"},
    "PadOwner": {"pad_templates", "pads", "sink", "src", "templates"},
    "Waits": {
        "activity", "changed", "clock", "flushes", "is_flushing", "is_waiting", "lock", "stopping", "timing",
        "waited_ns",
    },
    "Element": {
        "at_work", "bin", "drops", "factory", "has_failed", "host", "outcomes", "poster", "presets", "rank",
        "results", "uri_schemes", "written_paths",
    },
    "Source": {"over", "position_ns"},
    "Sink": {"position_ns"},
    "Transform": {"keeps_caps"},
    "Combine": {"combine_lock"},
    "FrameHolder": {"limits", "pending"},
    "OutputFileSink": {"example", "file", "has_begun", "names", "number", "suffixes", "write_errors"},
    "NumberedFilesSink": {"remembers_earlier_runs"},
    "TextFileSink": {"content", "file", "formats", "kinds"},
}  # fmt: skip


def use_of(owner: type, attribute: str) -> str:
    """What a base class of an element uses the name of a property for, such as "the method Element.stop".

    Args:
        owner: the class that declares the property.
        attribute: its name in the class.

    Returns:
        "" where the name is free. A plain value, such as `Source.is_live`, may become a property.
    """
    for base in owner.__mro__[1:]:
        found = vars(base).get(attribute)
        if inspect.isroutine(found):
            return f"the method {base.__name__}.{attribute}"
        is_engine = base.__module__.startswith("streamkit.")
        if is_engine and (isinstance(found, property) or attribute in ATTRIBUTES.get(base.__name__, ())):
            return f"the attribute {base.__name__}.{attribute}"
    return ""
