"""A tee with many branches is built in linear time."""

from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from streamkit import Pipeline
from streamkit.element.pad import Pad, PadTemplate
from streamkit.graph.negotiate import remembered_caps

FORMATS = st.sampled_from(
    ["", "! video/x-raw, format=GRAY8", "! video/x-raw, format={ BGR, GRAY8 }", "! video/x-raw, width=64"]
)


def teed(branches: list[str], name: str = "tee") -> str:
    """A tee with those branches."""
    return f"videotestsrc ! {name} name=t " + " ".join(
        f"t. ! queue {branch} ! fakesink" for branch in branches
    )


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[str]]:
    """Every question after caps, and every look whether a pad has a number."""
    found: list[str] = []
    asked, matched = Pad.query_caps, PadTemplate.matches
    monkeypatch.setattr(Pad, "query_caps", lambda pad: found.append("query") or asked(pad))
    monkeypatch.setattr(PadTemplate, "matches", lambda one, name: found.append("match") or matched(one, name))
    return found


@pytest.mark.parametrize("name", ["tee", "output-selector"])
def test_twice_the_branches_cost_twice_as_much(calls: list[str], name: str) -> None:
    """Branches are not compared pairwise."""
    Pipeline.parse(teed([""] * 50, name))
    few = len(calls)
    calls.clear()
    Pipeline.parse(teed([""] * 100, name))
    assert len(calls) < 2.2 * few


@given(st.lists(FORMATS, min_size=1, max_size=5))
def test_cached_caps_of_branches_equal_their_queries(branches: list[str]) -> None:
    """Computed for all branches at once."""
    graph = Pipeline.parse(teed(branches)).graph
    tee = graph.element("t")
    with remembered_caps(graph):
        noted = {pad: pad.known_caps for pad in tee.src_pads()}
        for pad in tee.src_pads():
            pad.known_caps = None
        assert noted == {pad: pad.query_caps() for pad in tee.src_pads()}


def test_numbers_of_pads_go_on_from_the_highest() -> None:
    """Also where names are given, and where a pad has gone."""
    tee = Pipeline.parse("tee name=t").graph.element("t")
    template = tee.pad_templates["src_%u"]
    given_names = ["", "", "src_7", "", "src_3", ""]
    assert [tee.request_pad(template, name).name for name in given_names] == [
        "src_0", "src_1", "src_7", "src_8", "src_3", "src_9",
    ]  # fmt: skip
    tee.release_pad(tee.pads["src_9"])
    tee.release_pad(tee.pads["src_8"])
    assert tee.request_pad(template).name == "src_8"
