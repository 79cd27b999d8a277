"""GStreamer's elements, properties and options whose work others do here, for the hint of an unknown name."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files


def _by_name(table: Mapping[str, str]) -> dict[str, str]:
    """What does the work, by GStreamer's name."""
    return {name: words for words, names in table.items() for name in names.split()}


TABLES = tomllib.loads((files("streamkit.element") / "gstreamer_names.toml").read_text(encoding="utf-8"))
ELEMENTS = TABLES["elements"]
BY_NAME = _by_name(ELEMENTS)
PROPERTIES = {element: _by_name(table) for element, table in TABLES["properties"].items()}
ANYWHERE = _by_name(TABLES["anywhere"])
OPTIONS = _by_name(TABLES["options"])


def gstreamer_hint(name: str) -> str:
    """What does the work of one of GStreamer's elements here, as a hint; "" if nothing does."""
    words = BY_NAME.get(name.lower(), "").replace("SOURCE", name.lower())
    return f"here: {words}" if words else ""


def property_hint(element: str, name: str) -> str:
    """What does the work of a property of GStreamer's in an element without it, as a hint; "" if unknown."""
    spelling = name.lower().rpartition("::")[2].replace("_", "-")  # of a pad's property, the property
    words = PROPERTIES.get(element, {}).get(spelling) or ANYWHERE.get(spelling, "")
    return f"here: {words}" if words else ""


def option_hint(option: str) -> str:
    """What does the work of an option of gst-launch's in `streamkit launch`, as a hint; "" if unknown."""
    words = OPTIONS.get(option, "")
    return f"here: {words}" if words else ""
