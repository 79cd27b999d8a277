"""Draws boxes and labelled arrows as SVG, in layers from top to bottom: every arrow leads downwards.

Source: Sugiyama, Tagawa and Toda, Methods for Visual Understanding of Hierarchical System Structures, 1981:
layers, dummy nodes for arrows across several of them, and the order in a layer by barycentres.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple
from xml.sax.saxutils import escape

FONT_PX, CHARACTER_PX, LINE_PX = 12, 7.3, 15
PADDING_PX, GAP_PX, LABEL_GAP_PX = 8, 30, 8
HEAD = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
    'font-family="monospace" font-size="{font}">'
    '<defs><marker id="end" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" '
    'orient="auto"><path d="M0,0 L8,4 L0,8 z"/></marker></defs>'
    "<style>text {{ paint-order: stroke; stroke: white; stroke-width: 3px }}</style>"
    '<rect width="100%" height="100%" fill="white"/>'
)


class Box(NamedTuple):
    """A box: the lines of its text, and its colour."""

    lines: Sequence[str]
    colour: str = "white"


class Arrow(NamedTuple):
    """An arrow between two boxes, by their indices, with the lines of its label."""

    start: int
    end: int
    lines: Sequence[str]


@dataclass
class _Node:
    """A box, or a point on an arrow that crosses a layer (`lines` is empty); `x` is its middle."""

    lines: Sequence[str]
    layer: int
    width: float
    height: float
    x: float = 0.0


def draw_svg(boxes: Sequence[Box], arrows: Sequence[Arrow]) -> str:
    """The drawing as an SVG document."""
    layers = _layers(len(boxes), arrows)
    nodes = [
        _Node(box.lines, layer, _width(box.lines), len(box.lines) * LINE_PX + 2 * PADDING_PX)
        for box, layer in zip(boxes, layers, strict=True)
    ]
    ways = [_way(arrow, nodes) for arrow in arrows]
    _place(nodes, ways, arrows)
    tops, height = _tops(nodes, ways, arrows)
    parts = [HEAD.format(width=_right(nodes, ways, arrows) + GAP_PX, height=height, font=FONT_PX)]
    for way, arrow in zip(ways, arrows, strict=True):
        parts.append(_drawn_arrow([nodes[index] for index in way], arrow, tops))
    parts += [_drawn_box(node, box, tops[node.layer]) for node, box in zip(nodes, boxes, strict=False)]
    return "\n".join([*parts, "</svg>"])


def _width(lines: Sequence[str]) -> float:
    return max(map(len, lines), default=0) * CHARACTER_PX + 2 * PADDING_PX


def _layers(count: int, arrows: Sequence[Arrow]) -> list[int]:
    """The layer of each box, below all boxes that lead to it; in a circle one arrow leads upwards."""
    found, waits_for = [0] * count, [0] * count
    following = defaultdict[int, list[int]](list)
    for arrow in arrows:
        following[arrow.start].append(arrow.end)
        waits_for[arrow.end] += 1
    left = dict.fromkeys(range(count))
    ready = [index for index in left if not waits_for[index]]
    while left:
        index = ready.pop(0) if ready else next(iter(left))
        if left.pop(index, 0) == 0:
            continue
        for end in following[index]:
            waits_for[end] -= 1
            if end in left:
                found[end] = max(found[end], found[index] + 1)
                ready += [end] if not waits_for[end] else []
    return found


def _way(arrow: Arrow, nodes: list[_Node]) -> list[int]:
    """The nodes on an arrow: its ends, and a new node in each layer between them."""
    start, end = nodes[arrow.start].layer, nodes[arrow.end].layer
    between = range(start + 1, end)
    nodes += [_Node((), layer, 0.0, 0.0) for layer in between]
    return [arrow.start, *range(len(nodes) - len(between), len(nodes)), arrow.end]


def _place(nodes: list[_Node], ways: list[list[int]], arrows: Sequence[Arrow]) -> None:
    """Gives each node its place in its layer: near the mean of those that lead to it, right of the last.

    The label of an arrow stands right of it, above its first node but one, which keeps the room.
    """
    before, rooms = defaultdict[int, list[int]](list), defaultdict[int, float](float)
    for way, arrow in zip(ways, arrows, strict=True):
        for start, end in pairwise(way):
            before[end].append(start)
        rooms[way[1]] = max(rooms[way[1]], _width(arrow.lines) + LABEL_GAP_PX)
    by_layer = defaultdict[int, list[int]](list)
    for index, node in enumerate(nodes):
        by_layer[node.layer].append(index)
    for layer in sorted(by_layer):
        wanted = {}
        for index in by_layer[layer]:
            leading = [nodes[start].x for start in before[index] if nodes[start].layer < layer]
            wanted[index] = sum(leading) / len(leading) if leading else 0.0
        right = 0.0
        for index in sorted(wanted, key=wanted.__getitem__):
            node = nodes[index]
            node.x = max(wanted[index], right + GAP_PX + node.width / 2)
            right = node.x + max(node.width / 2, rooms[index])


def _tops(nodes: list[_Node], ways: list[list[int]], arrows: Sequence[Arrow]) -> tuple[list[float], float]:
    """The upper edge of each layer, and the height of all; labels stand between layers."""
    count = max((node.layer for node in nodes), default=-1) + 1
    labels = [0.0] * (count + 1)
    for way, arrow in zip(ways, arrows, strict=True):
        above = nodes[way[0]].layer
        labels[above] = max(labels[above], len(arrow.lines) * LINE_PX)
    tops, at = list[float](), float(GAP_PX)
    for layer in range(count):
        tops.append(at)
        at += max(node.height for node in nodes if node.layer == layer) + labels[layer] + GAP_PX
    return tops, at


def _right(nodes: list[_Node], ways: list[list[int]], arrows: Sequence[Arrow]) -> float:
    boxes = [node.x + node.width / 2 for node in nodes]
    labels = [nodes[way[1]].x + _width(arrow.lines) for way, arrow in zip(ways, arrows, strict=True)]
    return max(boxes + labels, default=0.0)


def _drawn_box(node: _Node, box: Box, top: float) -> str:
    left = node.x - node.width / 2
    return (
        f'<rect x="{left:.1f}" y="{top:.1f}" width="{node.width:.1f}" height="{node.height:.1f}" rx="3" '
        f'fill="{box.colour}" stroke="black"/>' + _text(node.lines, left + PADDING_PX, top + PADDING_PX)
    )


def _drawn_arrow(way: list[_Node], arrow: Arrow, tops: list[float]) -> str:
    """A curve from the lower edge of a box through the points of its layers to the upper edge of another."""
    points = [(way[0].x, tops[way[0].layer] + way[0].height)]
    points += [(node.x, tops[node.layer]) for node in way[1:]]
    curve = "M{:.1f},{:.1f}".format(*points[0])
    for (x, y), (next_x, next_y) in pairwise(points):
        middle = (y + next_y) / 2
        curve += f" C{x:.1f},{middle:.1f} {next_x:.1f},{middle:.1f} {next_x:.1f},{next_y:.1f}"
    x, y = points[1]
    label = _text(arrow.lines, x + LABEL_GAP_PX, y - LABEL_GAP_PX - len(arrow.lines) * LINE_PX)
    return f'<path d="{curve}" fill="none" stroke="black" marker-end="url(#end)"/>{label}'


def _text(lines: Sequence[str], left: float, top: float) -> str:
    return "".join(
        f'<text x="{left:.1f}" y="{top + FONT_PX + number * LINE_PX:.1f}">{escape(line)}</text>'
        for number, line in enumerate(lines)
    )
