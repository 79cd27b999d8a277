"""Chains: the run of transforms behind a src pad, which one loop calls in turn, counts and times."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from streamkit.element.source import Source
from streamkit.element.transform import Transform
from streamkit.errors import ElementFailure, NotNegotiated
from streamkit.flow.frame import Frame
from streamkit.flow.signals import FlowStop
from streamkit.flow.video import layout_error

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import Pad


class Stage:
    """One element of a chain and what was counted of it.

    Attributes:
        element: a transform, or the element that the chain ends in.
        sink: the pad that frames come in through.
        call: takes one frame; of a transform it returns what goes on.
        is_terminal: whether the chain ends here.
        swallowed: frames for which a transform did not return exactly one frame.
        busy_ns: time spent in `call`, and in iterating over what it returned, ns.
        newest_ns: arrival time of the newest frame that came through, or 0.
    """

    __slots__ = ("busy_ns", "call", "element", "is_terminal", "newest_ns", "settles", "sink", "swallowed")

    def __init__(self, sink: Pad) -> None:
        self.element: Element = sink.element
        self.sink = sink
        self.is_terminal = not isinstance(sink.element, Transform)
        self.settles = isinstance(sink.element, Transform) and not sink.element.keeps_caps
        self.call: Callable[[Frame], Any] = (
            sink.element.transform if isinstance(sink.element, Transform) else sink.element.receiver(sink)
        )
        self.swallowed = self.busy_ns = self.newest_ns = 0


class Chain:
    """What stands behind one src pad, up to and with the next element that is not a transform.

    Attributes:
        src: the pad that pushes into the chain.
        stages: the elements in order, transforms that pass frames unseen included.
        frames: frames pushed into the chain.
        upstream_ns: time between the end of one push and the next, in which a source makes frames, ns.
    """

    def __init__(self, src: Pad) -> None:
        self.src = src
        self.stages: list[Stage] = []
        pad = src
        while pad.peer is not None:
            self.stages.append(Stage(pad.peer))
            if not isinstance(pad.peer.element, Transform):
                break
            pad = pad.peer.element.src_pad
        self._end = pad  # not linked where the last stage is not terminal
        self._called = tuple(stage for stage in self.stages if not _passes_unseen(stage))
        self._is_behind_source = isinstance(src.element, Source)
        self._left_ns = 0
        self.frames = self.upstream_ns = 0

    @property
    def terminal(self) -> Element | None:
        """The element that the chain ends in, or None where a pad is not linked."""
        return self.stages[-1].element if self.stages and self.stages[-1].is_terminal else None

    def push(self, frame: Frame) -> None:
        """Sends a frame through: each stage gets what the one before it returned.

        Raises:
            ElementFailure: a stage failed; names its element.
            FlowStop: downstream takes no more.
        """
        clock = time.perf_counter_ns
        self.frames += 1
        before = clock()
        if self._left_ns:
            self.upstream_ns += before - self._left_ns
        if self._is_behind_source:
            demand_layout(self.src.element, frame)
        stage: Stage | None = None
        try:
            for stage in self._called:
                element = stage.element
                element.enter("frame", before, frame)
                result = stage.call(frame)
                element.leave()
                now = clock()
                stage.busy_ns += now - before
                stage.newest_ns = frame.arrival_ns
                before = now
                if result.__class__ is not Frame:
                    if not stage.is_terminal:
                        self._push_each(stage, result)
                    return
                if result is not frame:
                    frame = self._settled(stage, result)
            if stage is None or not stage.is_terminal:
                self._end.not_linked(frame)
        except (FlowStop, ElementFailure, NotNegotiated):
            raise
        except Exception as cause:
            raise (stage.element if stage else self.src.element).failure(cause, frame) from cause
        finally:
            if stage is not None:
                stage.element.leave()
            self._left_ns = clock()

    def refresh(self) -> None:
        """Asks the element that the chain ends in anew for the function that takes its frames."""
        if self.terminal is not None:
            last = self.stages[-1]
            last.call = last.element.receiver(last.sink)

    def received(self) -> list[tuple[Stage, int]]:
        """Every stage with the number of frames that reached it, in the order of the chain."""
        rows: list[tuple[Stage, int]] = []
        count = self.frames
        for stage in self.stages:
            rows.append((stage, count))
            count -= stage.swallowed
        return rows

    @property
    def busy_ns(self) -> int:
        """Time spent in all stages, ns."""
        return sum(stage.busy_ns for stage in self.stages)

    def _settled(self, stage: Stage, frame: Frame) -> Frame:
        """A frame that a transform made, with the caps of its src pad and pixels that agree with them."""
        if stage.settles:
            assert isinstance(stage.element, Transform)
            frame = stage.element.settled(frame)
        demand_layout(stage.element, frame)
        return frame

    def _push_each(self, stage: Stage, results: Any) -> None:
        """A transform returned None or several frames: they go on behind its own src pads."""
        stage.swallowed += 1
        if results is None:
            return
        element, kind = stage.element, type(results).__name__
        assert isinstance(element, Transform)
        element.enter("frame", time.perf_counter_ns())
        for item in _timed(results, stage):
            name, frame = item if isinstance(item, tuple) and len(item) == 2 else ("", item)
            if not isinstance(frame, Frame):
                raise TypeError(
                    f"transform returns a Frame, several, or None, got {kind} "
                    f"of {type(frame).__name__}: put data into a frame with frame.replace(data=...)"
                )
            if name in ("", "src"):
                element.src_pad.push(self._settled(stage, frame))
            else:
                demand_layout(element, frame)
                element.push_aside(name, frame)
            element.enter("frame", time.perf_counter_ns(), frame)


def _timed(results: Iterable[Any], stage: Stage) -> Iterable[Any]:
    """The items of an iterable, whose making counts as work of the stage."""
    iterator = iter(results)
    while True:
        before = time.perf_counter_ns()
        try:
            item = next(iterator)
        except StopIteration:
            return
        finally:
            stage.busy_ns += time.perf_counter_ns() - before
        yield item


def _passes_unseen(stage: Stage) -> bool:
    return isinstance(stage.element, Transform) and stage.element.is_passthrough()


def demand_layout(element: Element, frame: Frame) -> None:
    """Raises an `ElementFailure` where the pixels of a frame are not what its caps say."""
    fault = layout_error(frame)
    if fault is not None:
        raise element.failure(ValueError(fault), frame)


def chain_on_first_frame(src: Pad, chains: list[Chain]) -> Callable[[Frame], None]:
    """A push that makes the chain behind a pad when the first frame comes, and adds it to `chains`."""

    def push(frame: Frame) -> None:
        chain = Chain(src)
        src.push = chain.push
        chains.append(chain)
        chain.push(frame)

    return push


class RetiredChainTotals:
    """What the chains of removed branches had counted of the element they hung on.

    Attributes:
        frames: that left the element for them, by the element's `id`.
        busy_ns: working time in them, ns, by the element's `id`.
    """

    def __init__(self) -> None:
        self.frames: Counter[int] = Counter()
        self.busy_ns: Counter[int] = Counter()

    def add(self, chain: Chain) -> None:
        """Adds what a chain has counted."""
        self.frames[id(chain.src.element)] += chain.frames
        self.busy_ns[id(chain.src.element)] += chain.busy_ns

    def forget(self, elements: Iterable[int]) -> None:
        """Drops the totals of elements, by their `id`, that are removed themselves."""
        for element in elements:
            self.frames.pop(element, None)
            self.busy_ns.pop(element, None)
