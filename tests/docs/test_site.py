"""The documentation site: all pages in the navigation, all public names in the reference, nothing remote."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import pytest

import streamkit
import streamkit.testing

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CONFIGURATION = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
REFERENCE = "\n".join(page.read_text(encoding="utf-8") for page in (DOCS / "reference").glob("*.md"))
REPOSITORY = "https://example.org/repository"


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    """docs/site_hooks.py, which is no package's."""
    spec = importlib.util.spec_from_file_location("site_hooks", DOCS / "site_hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_navigation_has_every_page_once() -> None:
    """A page that is left out, listed twice, or gone fails here, before `make docs` does."""
    listed = re.findall(r"^\s+- ([\w/-]+\.md)$", CONFIGURATION.partition("\nnav:\n")[2], re.MULTILINE)
    assert sorted(listed) == sorted(page.relative_to(DOCS).as_posix() for page in DOCS.rglob("*.md"))


def test_the_reference_has_every_public_name() -> None:
    """Each class and function that streamkit exports is on exactly one page; constants in words."""
    documented = re.findall(r"^::: ([\w.]+)$", REFERENCE, re.MULTILINE)
    assert len(documented) == len(set(documented))
    names = {f"streamkit.{name}" for name in streamkit.__all__}
    names |= {f"streamkit.testing.{name}" for name in streamkit.testing.__all__}
    described = set(re.findall(r"`(streamkit\.[A-Z_]+)`", REFERENCE))
    assert names - set(documented) - described == set()


@pytest.mark.parametrize("room", ["geometry", "handoff"])
def test_the_reference_has_every_module_of_a_library(room: str) -> None:
    """The rooms that are usable by themselves are documented whole."""
    for module in (ROOT / "streamkit" / room).glob("[a-z]*.py"):
        assert f"::: streamkit.{room}.{module.stem}\n" in REFERENCE


def test_links_that_leave_the_pages_lead_to_the_repository(hooks: ModuleType) -> None:
    """Within docs/, to other hosts and on the same page they stay as they are."""
    text = "[a](../../README.md) [b](../live-sources.md#times) [c](https://zenoh.io) [d](#times) [e](002.md)"
    assert hooks.repository_links(text, "decisions/001.md", REPOSITORY) == (
        f"[a]({REPOSITORY}/blob/main/README.md) [b](../live-sources.md#times) [c](https://zenoh.io) "
        "[d](#times) [e](002.md)"
    )


@pytest.mark.parametrize(
    ("text", "suffix"),
    [
        ('<script src="https://unpkg.com/shim"></script>', ".html"),
        ('<link rel="stylesheet" href="//fonts.example.org/a.css">', ".html"),
        ('<img alt="" src="https://example.org/badge.svg">', ".html"),
        ('<div style="background: url(https://example.org/a.png)">', ".html"),
        ('<div data-md-component="source">', ".html"),
        ('@import "https://example.org/a.css";', ".css"),
        ("body { background: url('//example.org/a.png') }", ".css"),
    ],
)
def test_a_page_that_asks_another_host_is_noticed(hooks: ModuleType, text: str, suffix: str) -> None:
    """Scripts, styles, fonts and images that a browser loads by itself."""
    assert hooks.external_requests(text, suffix)


def test_what_loads_nothing_is_allowed(hooks: ModuleType) -> None:
    """Links to follow, the canonical address, and files of the site."""
    text = (
        '<a href="https://zenoh.io">z</a> <link rel="canonical" href="https://example.org/a">'
        '<script src="assets/a.js"></script><img src="demo.jpg">'
    )
    assert hooks.external_requests(text, ".html") == []
    assert hooks.external_requests("body { background: url(a.png) }", ".css") == []
