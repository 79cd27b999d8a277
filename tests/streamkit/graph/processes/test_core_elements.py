"""Every element of the core does in a process of its own what it does without."""

import re
from collections.abc import Iterator
from typing import Any

import pytest

from streamkit.element.registry import available_elements, element_class
from streamkit.graph.pipeline import Pipeline
from streamkit.graph.processes.placement import IN_MAIN
from streamkit.graph.streaming import State

LIMIT_S = 80.0


def examples() -> Iterator[Any]:
    """The example line of every core element, with the element in a bin with a process."""
    for name, entry in available_elements().items():
        if "streamkit.elements." in entry.target and name not in IN_MAIN:
            doc = element_class(name).__doc__ or ""
            example = " ".join(doc.partition("Example:")[2].strip().partition("\n\n")[0].split())
            example = example.replace("video/x-raw, format=GRAY8, width=320", "capsfilter caps=video/x-raw")
            if name == "input-selector":  # whether another input has begun when the active one ends is open
                example = example.removesuffix(" fakesrc num-buffers=3 ! s.")
            bin_of_it = r"( process=true \g<0> )"
            yield pytest.param(example, re.sub(rf"\b{name}(?: [\w-]+=\S+)*", bin_of_it, example), id=name)


def results(text: str) -> tuple[object, list[object]]:
    """How the run ends, and what each element has counted."""
    with Pipeline.parse(text) as pipeline:
        pipeline.play()
        message = pipeline.wait(LIMIT_S)
        rows = [row for row in pipeline.statistics() if row.factory != "processlink"]
    assert message is not None
    counts = [(row.element, row.frames_in, row.frames_out, row.dropped) for row in rows]
    return (message.kind, message.text), sorted(counts, key=str)


@pytest.mark.parametrize(("plain", "in_process"), list(examples()))
def test_an_element_counts_the_same_in_a_process(plain: str, in_process: str) -> None:
    """Frames in, out and dropped, and the end of the run."""
    assert in_process.count("process=true") >= 1
    assert results(in_process) == results(plain)


@pytest.mark.parametrize(
    "text",
    [
        "videotestsrc num-buffers=30 ! ( process=true identity ) ! fakesink",
        "( process=true videotestsrc num-buffers=30 ) ! ( process=true queue ! fakesink sync=true )",
    ],
)
def test_a_process_goes_through_all_states(text: str) -> None:
    """Up and down: sinks in a process preroll, too."""
    with Pipeline.parse(text) as pipeline:
        pipeline.pause()
        assert pipeline.wait_prerolled(LIMIT_S)
        pipeline.play()
        pipeline.pause()
        pipeline.ready()
        assert pipeline.state is State.READY
        pipeline.play()
        assert pipeline.wait(LIMIT_S) is not None
        pipeline.stop()
        assert pipeline.state is State.NULL
