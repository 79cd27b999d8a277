"""Chains: the straight run of transforms behind a src pad, composed once into one function.

Frames pass through a chain in a flat loop, not in nested calls: a stage costs one call, no more, and a frame
that a stage has replaced is let go at once, so that `Frame.writable` can see a sole owner.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import repeat
from operator import length_hint
from typing import TYPE_CHECKING, Any

from streamkit.element.pad import SPECIAL
from streamkit.element.source import Source
from streamkit.element.transform import Transform
from streamkit.errors import ElementFailure, NotNegotiated
from streamkit.flow.frame import Frame
from streamkit.flow.signals import FlowStop
from streamkit.flow.video import misfit

if TYPE_CHECKING:
    from streamkit.element.base import Element
    from streamkit.element.pad import Line, Pad

SAMPLE_EVERY = 256  # one frame in so many is timed, and the first so many
SLOW_NS = 100_000  # each, where they come in no shorter a time: timing then costs nothing to speak of


class Chain:
    """What stands behind one src pad, up to and with the next element that is not a transform.

    Attributes:
        src: the pad that pushes into the chain.
        transforms: the transforms passed, in order.
        terminal: the element the chain ends in, or None where a pad is not linked.
        frames: frames pushed into the chain.
        swallowed: per transform, frames it did not return one frame for.
        busy_ns: per element, sampled working time, ns, scaled to all frames.
        newest_ns: per element, arrival time of the newest frame that was timed, or 0.
        sinks: the pads that frames come in through: one per transform, then the terminal's, if there is one.
        due: number of the next frame to be timed; 0 asks for the very next one.
        source_ns: behind a source, the sampled time between frames, in which it makes them, ns.
    """

    def __init__(self, src: Pad) -> None:
        self.src = src
        self.transforms: list[Transform] = []
        pad = src
        self.sinks: list[Pad] = []
        while pad.peer is not None and isinstance(pad.peer.element, Transform):
            self.transforms.append(pad.peer.element)
            self.sinks.append(pad.peer)
            pad = pad.peer.element.src_pad
        self.terminal: Element | None = None
        self._consume: Callable[[Frame], None] = pad.not_linked
        if pad.peer is not None:
            self.sinks.append(pad.peer)
            self.terminal = pad.peer.element
            self._consume = pad.peer.element.receiver(pad.peer)
        self.swallowed = [0] * len(self.transforms)
        self.busy_ns = [0] * (len(self.transforms) + 1)
        self.newest_ns = [0] * (len(self.transforms) + 1)
        self._due = 1
        self._count: Callable[[], int] = lambda: 0
        self._set_due: Callable[[int], None] = lambda number: None
        self.source_ns = self._timed_frames = self._timed_ns = self._ended_ns = self._gaps = 0
        self._takes_gaps = isinstance(src.element, Source)
        self._replace_consumer: Callable[[Callable[[Frame], None]], None] = lambda consume: None
        self._stages: list[Callable[[Frame], Any]] = []
        self._positions: dict[Callable[[Frame], Any], int] = {self._consume: len(self.transforms)}
        for position, transform in enumerate(self.transforms):
            if not transform.is_passthrough():
                self._stages.append(_stage(transform))
                self._positions[self._stages[-1]] = position

    def compose(self) -> Callable[[Frame], None]:  # noqa: PLR0915  three loops over one set of variables
        """The function that sends a frame through the chain.

        The count and the number of the next timed frame live in its closure, where they cost least.
        """
        stages, consume = tuple(self._stages), self._consume
        failed, timed, odd = self._failed, self._timed, self._odd
        count, due = self._count(), self._due
        row: tuple[int, repeat[None]] | None = None  # frames once it has passed, and what is left of it

        def push(frame: Frame) -> None:
            nonlocal count
            count += 1
            if count >= due:
                box = [frame]
                del frame  # the box is emptied: an element may still be the sole owner
                timed(box)
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

        def hand_over(frame: Frame) -> None:
            nonlocal count
            count += 1
            if count >= due:
                box = [frame]
                del frame
                timed(box)
                return
            try:
                consume(frame)
            except (FlowStop, ElementFailure, NotNegotiated):
                raise
            except Exception as cause:
                raise failed(consume, frame, cause) from cause

        def pull(line: Line) -> None:
            nonlocal count, row
            items, popleft = line.items, line.items.popleft
            while items:
                if line.care & SPECIAL:
                    return
                untimed = due - count - 1
                if untimed <= 0:
                    try:
                        if line.care:
                            line.weigh_out(items[0])  # type: ignore[arg-type]
                        box = [popleft()]
                    except IndexError:
                        return
                    count += 1
                    timed(box)  # type: ignore[arg-type]
                    continue
                # Counted before they pass: a loop over `left` costs less than counting each.
                left = repeat(None, min(len(items), untimed))
                total = count + length_hint(left)
                row = total, left
                try:
                    for _ in left:
                        if line.care:
                            if line.care & SPECIAL:
                                total -= 1  # the one that stays
                                break
                            line.weigh_out(items[0])  # type: ignore[arg-type]
                        consume(popleft())  # type: ignore[arg-type]  # a cast would cost a call for each frame
                except (FlowStop, ElementFailure, NotNegotiated):
                    raise
                except Exception as cause:
                    if _ran_empty(cause):
                        total -= 1
                        return
                    raise failed(consume, _frame_met(cause), cause) from cause
                finally:
                    count = total - length_hint(left)
                    row = None

        def frames() -> int:
            now = row
            return count if now is None else now[0] - length_hint(now[1])

        def replace_consumer(function: Callable[[Frame], None]) -> None:
            nonlocal consume
            consume = function

        def set_due(number: int) -> None:
            nonlocal due
            due = number

        self._replace_consumer, self._set_due = replace_consumer, set_due
        self._count = frames
        self.src.pull = None if stages else pull
        return push if stages else hand_over

    @property
    def frames(self) -> int:
        """Frames pushed into the chain."""
        return self._count()

    @property
    def due(self) -> int:
        """Number of the next frame to be timed."""
        return self._due

    @due.setter
    def due(self, number: int) -> None:
        self._due = number
        self._set_due(number)

    def refresh(self) -> None:
        """Asks the element the chain ends in anew for the function that takes its frames."""
        if self.terminal is not None:
            self._consume = self.terminal.receiver(self.sinks[-1])
            self._positions[self._consume] = len(self.transforms)
            self._replace_consumer(self._consume)

    def _timed(self, box: list[Frame]) -> None:
        """Sends the frame in the box through, taking the time of each element."""
        clock = time.perf_counter_ns
        arrived_ns = box[0].arrival_ns
        frame = box.pop()
        if self._takes_gaps:
            _demand_fitting(self.src.element, frame)
        stage: Callable[[Frame], Any] = self._consume
        before = clock()
        weight = self._schedule(before)
        try:
            for stage in self._stages:
                frame = stage(frame)
                now = clock()
                self._note(stage, (now - before) * weight, arrived_ns)
                before = now
                if frame.__class__ is not Frame:
                    self._odd(stage, frame, weight)
                    return
                _demand_fitting(self.transforms[self._positions[stage]], frame)
            stage = self._consume
            stage(frame)
            self._note(stage, (clock() - before) * weight, arrived_ns)
        except (FlowStop, ElementFailure, NotNegotiated):
            raise
        except Exception as cause:
            raise self._failed(stage, frame, cause) from cause
        finally:
            self._ended_ns = clock()

    def _note(self, stage: Callable[[Frame], Any], busy_ns: int, arrived_ns: int) -> None:
        position = self._positions[stage]
        self.busy_ns[position] += busy_ns
        self.newest_ns[position] = arrived_ns

    def _schedule(self, now_ns: int) -> int:
        """Says which frame is timed next; how many frames this one stands for."""
        count = self.frames
        weight, passed_ns = count - self._timed_frames, now_ns - self._timed_ns
        self._timed_frames, self._timed_ns = count, now_ns
        if weight == 1 and self._takes_gaps and self._ended_ns:
            self.source_ns += (now_ns - self._ended_ns) * (count - self._gaps)
            self._gaps = count
        is_next = count < SAMPLE_EVERY or passed_ns >= SLOW_NS * weight
        if weight > 1 and self._takes_gaps:
            is_next = True  # what lies between two timed frames is the source's time
        self.due = count + (1 if is_next else SAMPLE_EVERY)
        return weight

    def _odd(self, stage: Callable[[Frame], Any], result: Any, weight: int = 0) -> None:
        """A stage returned None or several frames, which go on behind its own src pad; timed if weighted."""
        position = self._positions[stage]
        self.swallowed[position] += 1
        if result is not None:
            push, kind = self.transforms[position].src_pad.push, type(result).__name__
            if weight:
                result = _TimedResults(result, self.busy_ns, position, weight)
            for frame in result:
                if not isinstance(frame, Frame):
                    raise TypeError(
                        f"transform returns a Frame, several, or None, got {kind} "
                        f"of {type(frame).__name__}: put data into a frame with frame.replace(data=...)"
                    )
                if weight:
                    _demand_fitting(self.transforms[position], frame)
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


def composed_when_used(src: Pad, chains: list[Chain]) -> Callable[[Frame], None]:
    """A push that composes the chain behind a pad when the first frame comes, and adds it to `chains`."""

    def push(frame: Frame) -> None:
        box = [frame]
        del frame  # the box is emptied: an element may still be the sole owner
        chain = Chain(src)
        src.push = chain.compose()
        chains.append(chain)
        src.push(box.pop())

    return push


def _demand_fitting(element: Element, frame: Frame) -> None:
    """Frames that are timed are looked at: an element that hands on other pixels than it says is told of."""
    fault = misfit(frame)
    if fault is not None:
        raise element.failure(ValueError(fault), frame)


def _ran_empty(cause: Exception) -> bool:
    """Whether a line was empty when the next frame was taken: upstream had just begun to drop the oldest."""
    trace = cause.__traceback__
    return isinstance(cause, IndexError) and trace is not None and trace.tb_next is None


def _frame_met(cause: Exception) -> Frame | None:
    """The frame that was being worked on where an exception was raised: nothing else may have held it."""
    trace = cause.__traceback__
    while trace is not None:
        for value in trace.tb_frame.f_locals.values():
            if isinstance(value, Frame):
                return value
        trace = trace.tb_next
    return None


class Parted:
    """What chains of branches that have gone add to the element they hung on.

    Attributes:
        frames: that left the element for them, by the element's `id`.
        busy_ns: sampled working time in them, ns, by the element's `id`.
    """

    def __init__(self) -> None:
        self.frames: Counter[int] = Counter()
        self.busy_ns: Counter[int] = Counter()

    def add(self, chain: Chain) -> None:
        """Takes over what a chain has counted."""
        self.frames[id(chain.src.element)] += chain.frames
        self.busy_ns[id(chain.src.element)] += sum(chain.busy_ns)

    def forget(self, elements: Iterable[int]) -> None:
        """Elements, by their `id`, have gone themselves."""
        for element in elements:
            self.frames.pop(element, None)
            self.busy_ns.pop(element, None)


class _TimedResults:
    """The frames of an iterable, whose making counts as work of its transform; it holds none of them."""

    def __init__(self, results: Iterable[Frame], busy_ns: list[int], position: int, weight: int) -> None:
        self._results = iter(results)
        self._busy_ns = busy_ns
        self._position = position
        self._weight = weight

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        before = time.perf_counter_ns()
        try:
            return next(self._results)
        finally:
            self._busy_ns[self._position] += (time.perf_counter_ns() - before) * self._weight


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
