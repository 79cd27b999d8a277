"""Drawings of boxes and arrows: what may not overlap, and that every graph has one."""

from itertools import combinations
from xml.etree import ElementTree

from hypothesis import given
from hypothesis import strategies as st

from streamkit.cli.layered_svg import Arrow, Box, draw_svg

SVG = "{http://www.w3.org/2000/svg}"
Area = tuple[float, float, float, float]


def boxes_of(drawing: str) -> list[Area]:
    """Left, top, right and bottom of each box, without the background."""
    found = []
    for box in list(ElementTree.fromstring(drawing).iter(f"{SVG}rect"))[1:]:
        left, top, width, height = (float(box.get(name, "nan")) for name in ("x", "y", "width", "height"))
        found.append((left, top, left + width, top + height))
    return found


def overlap(a: Area, b: Area) -> bool:
    """Whether two areas share a point."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def test_a_chain_leads_downwards() -> None:
    """Each box is below the one before; arrows end in heads, labels are text."""
    drawing = draw_svg(
        [Box(["a"]), Box(["b", "x=1"], "#ff0000"), Box(["c"])], [Arrow(0, 1, ["caps"]), Arrow(1, 2, [])]
    )
    tops = [top for _, top, _, _ in boxes_of(drawing)]
    assert tops == sorted(set(tops))
    assert drawing.count("marker-end") == 2
    assert ">caps</text>" in drawing
    assert 'fill="#ff0000"' in drawing


def test_a_long_arrow_passes_the_boxes_between_its_ends() -> None:
    """At each layer that it crosses it has a place of its own, beside the box there."""
    drawing = draw_svg(
        [Box(["source"]), Box(["decode"]), Box(["pair"])], [Arrow(0, 1, []), Arrow(1, 2, []), Arrow(0, 2, [])]
    )
    curve = drawing.split('<path d="')[-1].split('"')[0]
    left, _, right, _ = boxes_of(drawing)[1]
    x = float(curve.split(" C")[1].split()[-1].split(",")[0])
    assert not left < x < right


@given(st.integers(1, 12), st.lists(st.tuples(st.integers(0, 11), st.integers(0, 11)), max_size=25))
def test_every_graph_has_a_drawing_without_overlap(count: int, pairs: list[tuple[int, int]]) -> None:
    """Also one with circles and elements that nothing leads to; boxes do not cover each other."""
    boxes = [Box([f"element{index}", "x" * index]) for index in range(count)]
    arrows = [Arrow(start % count, end % count, ["caps"]) for start, end in pairs]
    areas = boxes_of(draw_svg(boxes, arrows))
    assert len(areas) == count
    assert not any(overlap(a, b) for a, b in combinations(areas, 2))
