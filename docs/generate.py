"""Writes docs/elements.md from what the elements declare.

Run it after a change of an element:  python docs/generate.py
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from streamkit.cli.inspect import describe_element
from streamkit.element.registry import installed_elements

TARGET = Path(__file__).with_name("elements.md")
PACKAGE = "streamkit"


def element_page(facts: dict[str, Any]) -> str:
    """The section of one element."""
    lines = [f"## {facts['name']}", "", facts["doc"], ""]
    if facts["example"]:
        lines += ["```sh", f'streamkit launch "{" ".join(facts["example"].split())}"', "```", ""]
    lines += ["| pad | presence | caps |", "|---|---|---|"]
    for pad in facts["pads"]:
        caps = pad["caps"].replace("|", "\\|").replace("; ", "<br>")
        lines.append(f"| {pad['name']} | {pad['direction']}, {pad['presence']} | {caps} |")
    if facts["properties"]:
        lines += ["", "| property | values | default | |", "|---|---|---|---|"]
        for item in facts["properties"]:
            default = "" if item["default"] is None else str(item["default"])
            mark = " (read only)" if item["readonly"] else " (live)" if item["live"] else ""
            values = item["values"].replace("|", "\\|") + mark
            lines.append(f"| `{item['name']}` | {values} | {default} | {item['doc']} |")
    return "\n".join([*lines, ""])


def document() -> str:
    """The whole page: every element of this distribution, in order of their names."""
    head = [
        "# Elements",
        "",
        "Made from the declarations by `python docs/generate.py`; `streamkit inspect NAME` shows the same.",
        "A property marked live may change while the pipeline plays; one marked read only is told, not set.",
        "",
    ]
    names = [entry.name for entry in installed_elements().values() if entry.package == PACKAGE]
    return "\n".join([*head, *(element_page(describe_element(name)) for name in names)])


if __name__ == "__main__":
    TARGET.write_text(document(), encoding="utf-8")
