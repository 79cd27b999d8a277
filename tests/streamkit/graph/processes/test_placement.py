"""Where a graph is cut, and which descriptions cannot be."""

import pytest

from streamkit import DescriptionError
from streamkit.graph.build import build
from streamkit.graph.pipeline import Pipeline


def test_a_link_between_two_processes_gets_a_process_link() -> None:
    """Only there: links inside a bin, and between bins in one process, stay as they are."""
    text = "fakesrc ! ( process=true identity ! queue ) ! ( identity ) ! ( process=true identity ! fakesink )"
    graph = build(text, {})
    ends = [tuple(None if end is None else end.name for end in pair) for pair in graph.process_links.values()]
    assert ends == [(None, "bin0"), ("bin0", None), (None, "bin2")]
    assert [element.name for element in graph.inserted] == ["processlink0", "processlink1", "processlink2"]


def test_an_element_runs_in_the_innermost_process() -> None:
    """A bin in a bin may have a process of its own, or run in the outer one's."""
    text = (
        "( process=true name=a fakesrc ! ( process=true name=b identity name=i ) ! ( identity name=j ) "
        "! fakesink name=k )"
    )
    graph = build(text, {})
    homes = {element.name: home.name for element, home in graph.homes.items()}
    assert homes == {"fakesrc0": "a", "i": "b", "j": "a", "k": "a"}


def test_a_converter_runs_where_its_source_does() -> None:
    """Negotiation comes before the cut, so the same converter is at work with and without processes."""
    graph = build(
        "( process=true videotestsrc ! capsfilter caps=video/x-raw,format=BGR ) ! framediff ! fakesink", {}
    )
    converter = next(element for element in graph.inserted if element.factory == "videoconvert")
    assert graph.homes[converter].name == "bin0"


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("fakesrc ! ( process=true appsink )", "is called by the application"),
        ("( process=true appsrc ) ! fakesink", "is called by the application"),
        ("( process=true restart=1 fakesrc ) ! fakesink", "would start over"),
        ("demux name=d  d.video_0 ! ( process=true fakesink )", "waits for a pad of the stream"),
    ],
)
def test_what_cannot_be_cut_is_refused(text: str, rule: str) -> None:
    """The error points at the place, and says what to do."""
    with pytest.raises(DescriptionError, match=rule) as error:
        build(text, {})
    assert error.value.hint


def test_a_setting_without_a_process_is_reported() -> None:
    """It would be forgotten otherwise that `process=true` is missing."""
    warnings = build("fakesrc ! ( restart=3 identity ) ! fakesink", {}).warnings
    assert ("no-effect", "bin0: restart has no effect without process=true") in warnings


@pytest.mark.parametrize(
    ("name", "branch"), [("t", "queue ! fakesink"), ("u", "queue ! ( process=true fakesink )")]
)
def test_branches_stay_in_the_main_process(name: str, branch: str) -> None:
    """Frames would never reach them."""
    text = "fakesrc ! tee name=u ! ( process=true tee name=t ! fakesink )"
    with pytest.raises(DescriptionError, match="in the main process only"):
        Pipeline.parse(text).add_branch(name, branch)
