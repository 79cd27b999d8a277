"""Notes on open ends; test_launch.py has those of elements with one input and one output."""

import pytest

from streamkit.graph.build import build
from streamkit.graph.link import open_ends


@pytest.mark.parametrize(
    ("text", "notes"),
    [
        ("funnel name=f ! fakesink", ["f has no input, no frame comes; write a source ! f."]),
        ("funnel name=f ! fakesink  fakesrc ! f.", []),
        (
            "videotestsrc ! framediff name=d  d.mask ! fakesink",
            ["d.src is not linked, its frames go nowhere; link it to a sink"],
        ),
        ("videotestsrc ! framediff ! fakesink", []),
        ("fakesrc ! tee name=t ! fakesink  t. ! fakesink", []),
    ],
)
def test_an_open_end_beside_others_is_noted(text: str, notes: list[str]) -> None:
    """The run waits for ever, or its frames are lost behind a tee, and ends with code 0."""
    assert list(open_ends(build(text, {}))) == notes
