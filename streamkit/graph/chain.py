"""Chains: the straight run of transforms behind a src pad, composed once into one function.

Frames pass through a chain in a flat loop, not in nested calls: a stage costs one call, no more, and a frame
that a stage has replaced is let go at once, so that `Frame.writable` can see a sole owner.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from streamkit.element.transform import Transform
from streamkit.errors import ElementFailure, NotNegotiated
from streamkit.flow.frame import Frame
from streamkit.flow.signals import FlowStop

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import Pad

SAMPLE_EVERY = 64  # one frame in so many is timed


class Chain:
    """What stands behind one src pad, up to and with the next element that is not a transform.

    Attributes:
        src: the pad that pushes into the chain.
        transforms: the transforms passed, in order.
        terminal: the element the chain ends in, or None where a pad is not linked.
        frames: frames pushed into the chain.
        swallowed: per transform, frames it did not return one frame for.
        busy_ns: per element, sampled working time, ns, scaled to all frames.
    """

    def __init__(self, src: Pad) -> None:
        self.src = src
        self.transforms: list[Transform] = []
        pad = src
        while pad.peer is not None and isinstance(pad.peer.element, Transform):
            self.transforms.append(pad.peer.element)
            pad = pad.peer.element.src_pad
        self.terminal: Element | None = None
        self._consume: Callable[[Frame], None] = pad.not_linked
        if pad.peer is not None:
            self.terminal = pad.peer.element
            self._consume = pad.peer.element.receiver(pad.peer)
        self.frames = 0
        self.swallowed = [0] * len(self.transforms)
        self.busy_ns = [0] * (len(self.transforms) + 1)
        self._stages: list[Callable[[Frame], Any]] = []
        self._positions: dict[Callable[[Frame], Any], int] = {self._consume: len(self.transforms)}
        for position, transform in enumerate(self.transforms):
            if not transform.is_passthrough():
                self._stages.append(_stage(transform))
                self._positions[self._stages[-1]] = position

    def compose(self) -> Callable[[Frame], None]:
        """The function that sends a frame through the chain."""
        stages, consume, chain = tuple(self._stages), self._consume, self
        failed, timed, odd = self._failed, self._timed, self._odd

        def push(frame: Frame) -> None:
            chain.frames = count = chain.frames + 1
            if not count % SAMPLE_EVERY:
                timed(frame)
                return
            stage: Callable[[Frame], Any] = consume
            try:
                for stage in stages:
                    frame = stage(frame)
                    if frame.__class__ is not Frame:
                        odd(stage, frame)
                        return
                stage = consume
                consume(frame)
            except (FlowStop, ElementFailure, NotNegotiated):
                raise
            except Exception as cause:
                raise failed(stage, frame, cause) from cause

        return push

    def _timed(self, frame: Frame) -> None:
        """Sends one frame through, taking the time of each element."""
        clock = time.perf_counter_ns
        stage: Callable[[Frame], Any] = self._consume
        before = clock()
        try:
            for stage in self._stages:
                frame = stage(frame)
                now = clock()
                self.busy_ns[self._positions[stage]] += (now - before) * SAMPLE_EVERY
                before = now
                if frame.__class__ is not Frame:
                    self._odd(stage, frame)
                    return
            stage = self._consume
            stage(frame)
            self.busy_ns[-1] += (clock() - before) * SAMPLE_EVERY
        except (FlowStop, ElementFailure, NotNegotiated):
            raise
        except Exception as cause:
            raise self._failed(stage, frame, cause) from cause

    def _odd(self, stage: Callable[[Frame], Any], result: Any) -> None:
        """A stage returned None or several frames, which go on behind its own src pad."""
        position = self._positions[stage]
        self.swallowed[position] += 1
        if result is not None:
            push = self.transforms[position].src_pad.push
            for frame in result:
                if not isinstance(frame, Frame):
                    raise TypeError(
                        f"transform returns a Frame, several, or None, got {type(result).__name__} "
                        f"of {type(frame).__name__}: put data into a frame with frame.replace(data=...)"
                    )
                push(frame)

    def _failed(self, stage: Callable[[Frame], Any], frame: Any, cause: Exception) -> ElementFailure:
        position = self._positions[stage]
        element = self.transforms[position] if position < len(self.transforms) else self.terminal
        assert element is not None
        return element.failure(cause, frame if isinstance(frame, Frame) else None)

    def received(self) -> list[tuple[Element, int, int]]:
        """Element, frames that reached it, and its sampled busy time in ns, in the order of the chain."""
        rows: list[tuple[Element, int, int]] = []
        count = self.frames
        for transform, lost, busy in zip(self.transforms, self.swallowed, self.busy_ns, strict=False):
            rows.append((transform, count, busy))
            count -= lost
        if self.terminal is not None:
            rows.append((self.terminal, count, self.busy_ns[-1]))
        return rows


def _stage(transform: Transform) -> Callable[[Frame], Any]:
    """The function a chain calls: `transform` itself where caps stay, else with a check of the caps."""
    if transform.keeps_caps:
        return transform.transform
    function, settled = transform.transform, transform.settled
    pad = transform.src_pad

    def with_caps(frame: Frame) -> Any:
        result: Any = function(frame)
        if result.__class__ is Frame:
            return result if result.caps is pad.caps else settled(result)
        return result if result is None else map(settled, result)

    return with_caps
