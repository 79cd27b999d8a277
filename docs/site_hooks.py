"""Hooks of the documentation site: links that leave docs/, and no requests to other hosts.

mkdocs calls `on_page_markdown` for each page and `on_post_build` for the finished site (see mkdocs.yml).
"""

from __future__ import annotations

import posixpath
import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

LINK = re.compile(r"(?<=\]\()([^)\s#]+)(#[^)\s]*)?(?=\))")
REMOTE = re.compile(r"(?:https?:)?//")
REMOTE_IN_CSS = re.compile(r"(?:url\(\s*['\"]?|@import\s+['\"])(?:https?:)?//[^)'\"\s]*")
LOADED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "object": "data"}
# Parts of the theme whose script asks other hosts: repository facts and Mermaid.
ASKING_PARTS = ('data-md-component="source"', 'class="mermaid"')


def repository_links(markdown: str, page: str, repository: str) -> str:
    """Points relative links that leave docs/ at the repository.

    Args:
        markdown: text of the page.
        page: its path within docs/, "decisions/001.md".
        repository: URL of the repository.
    """

    def target(match: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), match[1]))
        if "://" in match[1] or path.startswith(("docs/", "..")):
            return match[0]
        return f"{repository}/blob/main/{path}{match[2] or ''}"

    return LINK.sub(target, markdown)


class _Requests(HTMLParser):
    """Collects the addresses on other hosts that a browser loads by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Looks at what this tag loads; a link to follow and the canonical address load nothing."""
        values = {name: value or "" for name, value in attrs}
        address = values.get(LOADED.get(tag, ""), "")
        if tag == "link" and values.get("rel") != "canonical":
            address = values.get("href", "")
        if REMOTE.match(address):
            self.found.append(address)


def external_requests(text: str, suffix: str) -> list[str]:
    """What a built file makes a browser ask of other hosts.

    Args:
        text: content of the file.
        suffix: ".html" or ".css".
    """
    if suffix == ".css":
        return REMOTE_IN_CSS.findall(text)
    parser = _Requests()
    parser.feed(text)
    return [*parser.found, *REMOTE_IN_CSS.findall(text), *(part for part in ASKING_PARTS if part in text)]


def on_page_markdown(markdown: str, *, page: Any, config: Any, **_: Any) -> str:
    """Rewrites links of one page."""
    return repository_links(markdown, page.file.src_uri, config["extra"]["repository"])


def on_post_build(*, config: Any, **_: Any) -> None:
    """Fails the build where a page asks another host for anything."""
    from mkdocs.exceptions import PluginError

    site = Path(config["site_dir"])
    for path in sorted(item for item in site.rglob("*") if item.suffix in (".html", ".css")):
        found = external_requests(path.read_text(encoding="utf-8"), path.suffix)
        if found:
            raise PluginError(
                f"{path.relative_to(site)}: built pages must load nothing from other hosts, "
                f"this one asks for {found[0]}; ship the file in docs/, or switch the feature off"
            )
