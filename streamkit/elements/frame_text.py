"""Texts about a frame, for messages."""

from __future__ import annotations

from streamkit.element.pad import Pad
from streamkit.flow.frame import Frame
from streamkit.handoff.frame_queue import data_size

MOST_DUMPED = 4096


def frame_text(verb: str, pad: Pad, frame: Frame) -> str:
    """One line: what was done where, with the frame's size and times in ns."""
    return (
        f"{verb} ******* ({pad.path}) ({data_size(frame.data)} bytes, pts: {frame.pts}, "
        f"duration: {frame.duration}, seq: {frame.seq}, flags: {frame.flags:#x})"
    )


def dump_text(frame: Frame) -> str:
    """The first bytes of a frame in hexadecimal, 16 a line with their offset."""
    try:
        content = bytes(memoryview(frame.data).cast("B")[:MOST_DUMPED])
    except (TypeError, ValueError):  # no bytes, or not in one piece
        return repr(frame.data)[:MOST_DUMPED]
    return "\n".join(
        f"{start:08x}: {content[start : start + 16].hex(' ')}" for start in range(0, len(content), 16)
    )
