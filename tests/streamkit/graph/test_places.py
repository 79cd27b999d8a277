"""Bins: names and ghost pads."""

import pytest

from streamkit import Pipeline
from streamkit.errors import DescriptionError
from streamkit.graph.build import build


def ghosts(text: str) -> dict[str, dict[str, str]]:
    """The ghost pads of each bin that has some."""
    return {group.name: group.ghost_pads for group in build(text, {}).bins if group.ghost_pads}


def test_a_link_has_a_ghost_pad_on_every_bin_border() -> None:
    """pl-ok-14: numbered in the order of the links, from the inside out, the source's side first."""
    text = "deepsrc. ! fakesink fakesrc ! ( identity ! ( identity ! ( identity name=deepsrc ) ) )"
    assert ghosts(text) == {
        "bin0": {"ghost0": "deepsrc.src", "ghost3": "deepsrc.sink"},
        "bin1": {"ghost1": "bin0.ghost0", "ghost4": "identity1.sink"},
        "bin2": {"ghost2": "bin1.ghost1", "ghost5": "identity0.sink"},
    }


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("( fakesrc ! fakesink )", {}),
        ("( fakesrc ) ! fakesink", {"bin0": {"ghost0": "fakesrc0.src"}}),
        ("( fakesrc name=s ( fakesink name=k ) s. ! k. )", {"bin0": {"ghost0": "k.sink"}}),
        ("( fakesrc ) ! a/b ! fakesink", {"bin0": {"ghost0": "capsfilter0.src"}}),
        ("fakesrc ! a/b ! ( fakesink )", {"bin0": {"ghost0": "fakesink0.sink"}}),
        ("videotestsrc : a/b ! ( fakesink ) fakesrc ! fakesink", {}),
        (
            "( fakesrc name=s ) ( fakesrc name=t ) s. : ( fakesink )  t. ! a/b ! fakesink",
            {
                "bin0": {"ghost0": "s.src"},
                "bin2": {"ghost1": "fakesink0.sink"},
                "bin1": {"ghost2": "capsfilter0.src"},
            },
        ),
    ],
)
def test_links_inside_a_bin_have_no_ghost_pads(text: str, expected: dict[str, dict[str, str]]) -> None:
    """A filter is in the bin of its source."""
    assert ghosts(text) == expected


def test_names_are_unique_in_a_bin() -> None:
    """r34: two of one name are refused, wherever they are linked; a bin's name counts too."""
    for text in (
        "fakesrc name=a fakesink name=a",
        "( fakesrc name=a identity name=a )",
        "fakesrc name=a ( name=a identity )",
        "fakesrc name=capsfilter0 ! a/b ! fakesink",
    ):
        with pytest.raises(DescriptionError, match="two elements are named") as caught:
            build(text, {})
        assert caught.value.code == "link"
    assert build("( fakesrc name=a ) ( fakesink name=a ) queue name=a", {}).elements


def test_the_name_of_the_only_bin_cannot_be_referenced() -> None:
    """As in gst-launch, which returns that bin."""
    with pytest.raises(DescriptionError) as caught:
        build("( name=b fakesrc name=s b. ! s. )", {})
    assert caught.value.code == "no-such-element"


def test_elements_of_one_name_run_beside_each_other() -> None:
    """r35: equal names in different bins; each is found by its bin's name too."""
    text = "".join(
        f"( name={n} fakesrc num-buffers={c} name=a ! fakesink name=b ) " for n, c in (("x", 2), ("y", 5))
    )
    with Pipeline.parse(text) as pipeline:
        assert pipeline["x/a"] is not pipeline["y/a"]
        assert pipeline["a"] is pipeline["x/a"]
        pipeline.run(timeout_s=30)
        counted = {f"{row.parent}/{row.element}": row.frames_in for row in pipeline.statistics()}
    assert counted == {"x/a": 0, "x/b": 2, "y/a": 0, "y/b": 5}
