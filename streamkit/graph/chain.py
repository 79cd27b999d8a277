"""Chains: the transforms downstream of a src pad, in one loop."""

from __future__ import annotations

import operator
import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import TYPE_CHECKING, Any, NoReturn

from streamkit.element.base import AT_WORK, IDLE, Element
from streamkit.element.sink import Sink
from streamkit.element.source import Source
from streamkit.element.transform import Transform
from streamkit.errors import ElementFailure, NotNegotiated, StreamError, StreamkitError
from streamkit.flow.events import EndOfStream, FlowStop
from streamkit.flow.frame import Frame
from streamkit.flow.video import check_layout

if TYPE_CHECKING:
    from streamkit.element.pad import Pad

PLAIN_TIMES = (int, type(None))


class Stage:
    """One element of a chain and its counters.

    Attributes:
        element: a transform, or the last element of the chain.
        sink: the pad through which frames arrive.
        src_pad: the pad `src` of a transform, else None.
        call: called with each frame; returns the output of a transform.
        is_terminal: whether the chain ends here.
        not_passed_on: frames for which a transform raised, or returned none or several; its own src pads push
            several.
        busy_ns: time spent in `call`, and in iterating over its result, ns.
        newest_ns: arrival time of the newest frame, or 0.
    """

    __slots__ = (
        "busy_ns", "call", "element", "is_terminal", "newest_ns", "not_passed_on", "sink", "src_pad",
    )  # fmt: skip

    def __init__(self, sink: Pad) -> None:
        self.element: Any = sink.element
        self.sink = sink
        transform = sink.element if isinstance(sink.element, Transform) else None
        self.is_terminal = transform is None
        self.src_pad: Any = transform.src_pad if transform else None
        self.call: Callable[[Frame], Any] = transform.transform if transform else sink.element.receiver(sink)
        self.not_passed_on = self.busy_ns = self.newest_ns = 0


class Chain:
    """The elements downstream of a src pad, up to the first one that is not a transform.

    A transform that returns several frames pushes them by its own src pads, each with a chain of its own: the
    elements behind it are then in two chains, and each frame goes through one of them.

    Attributes:
        src: the pad that pushes into the chain.
        stages: the elements in order, including bypassed transforms.
        frames: frames pushed into the chain.
        upstream_ns: time between pushes, in which a source produces frames, ns.
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
        self._end = pad  # not linked if the last stage is not terminal
        self._called = tuple(
            stage for stage in self.stages if stage.is_terminal or not stage.element.is_passthrough()
        )
        self._is_behind_source = isinstance(src.element, Source)
        self._left_ns = 0
        self._has_failed = False
        self.frames = self.upstream_ns = 0

    def push(self, frame: Frame) -> None:
        """Sends a frame through all stages.

        Raises:
            ElementFailure: an element failed.
            FlowStop: downstream accepts no more frames, as after a failure.
        """
        if self._has_failed:
            raise EndOfStream(self.src.path)
        clock = time.perf_counter_ns
        self.frames += 1
        before = clock()
        self.upstream_ns += before - self._left_ns if self._left_ns else 0
        stage: Stage | None = None
        called: Stage | None = None
        try:
            for stage in self._called:
                called, element = stage, stage.element
                # Element.enter and leave, and isinstance, written out: this runs for every element and frame.
                element.activity = ("frame", before, frame)
                element.at_work[0] = AT_WORK
                if stage.is_terminal and frame.pts.__class__ not in PLAIN_TIMES:
                    frame = frame.replace(pts=plain_time(frame))
                result = stage.call(frame)
                called = element.activity = None
                element.at_work[0] = IDLE
                now = clock()
                stage.busy_ns += now - before
                stage.newest_ns = frame.arrival_ns
                before = now
                if result.__class__ is not Frame:
                    if not stage.is_terminal:
                        self._push_each(stage, result)
                    return
                if result is not frame:
                    check_layout(result)
                    frame = result
                    if frame.caps is not stage.src_pad.caps:
                        frame = stage.element.announce_src_caps(frame)
            if stage is None or not stage.is_terminal:
                self._end.not_linked(frame)
        except (Exception, SystemExit) as cause:
            self._raise(cause, stage.element if stage else self.src.element, frame, called)
        finally:
            if stage is not None and stage.element.activity is not None:
                stage.element.leave()
            if self._is_behind_source:
                self._left_ns = clock()

    def refresh(self) -> None:
        """Gets the receiver function again if the chain ends in a sink."""
        if self.stages and isinstance(self.stages[-1].element, Sink):
            last = self.stages[-1]
            last.call = last.element.receiver(last.sink)

    def received(self) -> list[tuple[Stage, int]]:
        """Every stage with the number of frames that reached it, in order."""
        rows: list[tuple[Stage, int]] = []
        count = self.frames
        for stage in self.stages:
            rows.append((stage, count))
            count -= stage.not_passed_on
        return rows

    @property
    def busy_ns(self) -> int:
        """Time spent in all stages, ns."""
        return sum(stage.busy_ns for stage in self.stages)

    def _raise(self, cause: BaseException, element: Element, frame: Frame, called: Stage | None) -> NoReturn:
        """Raises an exception of a call with a frame: as it is, or as a failure of the element called.

        `called` is the stage whose call raised it, and so passed nothing on.
        """
        if called is not None:
            called.not_passed_on += 1
        if isinstance(cause, FlowStop):
            raise cause
        self._has_failed = True
        if isinstance(cause, ElementFailure | NotNegotiated):
            raise cause
        element.has_failed = True
        if called is not None and not isinstance(cause, StreamkitError):
            try:
                check_layout(frame, needs_array=True)
            except (ValueError, TypeError) as fault:
                met = f"{type(cause).__name__}: {str(cause).partition(chr(10))[0]}"
                cause = StreamError(f"{fault}; see the element that made the frame ({met})")
        raise element.failure(cause, frame) from cause

    def _push_each(self, stage: Stage, results: Any) -> None:
        """Pushes the frames of a transform that returned None or several to its own src pads."""
        stage.not_passed_on += 1
        if results is None:
            return
        element, kind = stage.element, type(results).__name__
        element.enter("frame", time.perf_counter_ns())
        for item in _timed(results if isinstance(results, Iterable) else (results,), stage):
            name, frame = item if isinstance(item, tuple) and len(item) == 2 else ("src", item)
            if not isinstance(frame, Frame):
                of = "" if frame is results else f" of {type(frame).__name__}"
                remedy = "put data into a frame with frame.replace(data=...)"
                if isinstance(results, tuple) and isinstance(frame, str):
                    remedy = f'for another pad, write yield "{frame}", frame'
                raise TypeError(f"transform returns a Frame, several, or None, got {kind}{of}: {remedy}")
            element.push_output(name, frame)
            element.enter("frame", time.perf_counter_ns(), frame)


def plain_time(frame: Frame) -> int:
    """The time of a frame that has an integer of another kind, as NumPy's, which no file or message takes.

    Raises:
        StreamError: it is no integer.
    """
    try:
        return operator.index(frame.pts)  # type: ignore[arg-type]
    except TypeError:
        raise StreamError(
            f"the pts of a frame must be an integer, ns, or None, it is {frame.pts!r}; "
            "see the element that made it"
        ) from None


def _timed(results: Iterable[Any], stage: Stage) -> Iterable[Any]:
    """Iterates over results; the time is counted as work of the stage."""
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


def compose_chains(elements: Iterable[Element], chains: list[Chain]) -> None:
    """Composes the chain of every src pad of some elements and appends it to `chains`."""
    for element in elements:
        for pad in list(element.src_pads()):
            if isinstance(element, Transform):
                pad.push = partial(_push_first, pad, chains)
            else:
                compose_chain(pad, chains)
        element.pads_changed()


def compose_chain(src: Pad, chains: list[Chain]) -> Chain:
    """Composes the chain of a src pad and appends it to `chains`."""
    chain = Chain(src)
    src.push = chain.push
    chains.append(chain)
    return chain


def _push_first(src: Pad, chains: list[Chain], frame: Frame) -> None:
    """Composes the chain behind a transform when it first returns several frames."""
    compose_chain(src, chains).push(frame)
