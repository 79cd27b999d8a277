"""Element: the base class of everything in a graph."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from streamkit.element.code_place import place_of, traceback_of
from streamkit.element.pad import Pad
from streamkit.element.pad_owner import PadOwner
from streamkit.element.property_owner import PropertyOwner
from streamkit.element.timing import Timing
from streamkit.errors import ElementFailure, NotNegotiated, StateError, StreamkitError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.clock import Clock, SystemClock
from streamkit.flow.events import FlowStop, Flushing
from streamkit.flow.messages import Message, MessageKind
from streamkit.handoff.bounded_queue import POLL_S

if TYPE_CHECKING:
    from streamkit.element.host import Host
    from streamkit.flow.events import Event
    from streamkit.flow.frame import Frame

log = logging.getLogger("streamkit")
AT_WORK, IDLE = ord("1"), ord("0")


class Element(PadOwner, PropertyOwner):
    """One element of a graph.

    Authors subclass `Source`, `Transform`, `Sink`, `Combine` or `Split`. They declare pads as caps in `sink`
    and `src` (always pads) or as `PadTemplate`s in `templates`, and properties with `Property(...)`, and
    override `start` and `stop` to acquire and release resources, and `begin_run` to reset the state of a run.

    Further class attributes: `presets` (property values by preset name), `uri_schemes` that `location`
    accepts in descriptions that contain only a URI, and the `rank` among elements with the same scheme.

    Attributes:
        name, factory: unique in its bin; element type.
        bin: the enclosing bin, or None.
        stopping: set while the pipeline stops; every wait of an element checks it.
        clock: the pipeline's clock.
        timing: the pipeline's running time.
        lock: guards state that threads of the element share.
        changed: the condition on `lock` to wait on; `wake` notifies it, as each change of state does.
        is_flushing: whether a flush is in progress; frames are refused.
        flushes: number of flushes started; a wait during which it grows is cancelled.
        drops: number of frames not delivered, by reason.
        results: number of things that the element has made, such as tracks, by name in the plural.
        outcomes: number of frames by what the element has found of each, such as "lost".
        has_failed: whether a call by the engine has raised in this run; the element is then not drained.
        activity: name, start (perf_counter, ns) and frame of the current call by the engine, else None.
        is_waiting: whether the element waits on purpose; the watchdog then ignores it.
        waited_ns: time of calls with frames in which it waited on purpose, ns; not counted as work.
        at_work: one byte, "1" during a call, else "0"; in memory shared with the crash reporter.
    """

    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    uri_schemes: ClassVar[tuple[str, ...]] = ()
    rank: ClassVar[int] = 0

    def __init__(self, name: str = "", **properties: Any) -> None:
        super().__init__()
        self.factory = type(self).__name__.lower()
        self.name = name or self.factory
        self.bin: Element | None = None
        self.stopping = threading.Event()
        self.lock = threading.RLock()
        self.changed = threading.Condition(self.lock)
        self._state_changed = self.changed  # a class of an author may use that name
        self._woken = threading.Event()  # ends waits for a time of the clock
        self.is_flushing = False
        self.flushes = 0
        self.clock: Clock = SystemClock()
        self.timing = Timing(lambda: self.clock)
        self.host: Host | None = None
        self.drops: Counter[str] = Counter()
        self.results: Counter[str] = Counter()
        self.outcomes: Counter[str] = Counter()
        self._warned_of: set[str] = set()
        self.activity: tuple[str, int, Frame | None] | None = None
        self.at_work = memoryview(bytearray(b"0"))
        self.poster: Callable[[Message], None] | None = None
        self.is_waiting = False
        self.begin_run()
        for key, value in properties.items():
            self.set_property(key, value)

    def __repr__(self) -> str:
        return f"<{self.factory} {self.name!r}>"

    @property
    def parent(self) -> str:
        """Name of the enclosing bin, or ""."""
        return self.bin.name if self.bin is not None else ""

    # Overridden by authors.

    def start(self) -> None:
        """Acquires resources; raises `ResourceError` if one is not available."""

    def stop(self) -> None:
        """Releases all resources; always runs once `start` began, also after it failed."""

    def interrupt(self) -> None:
        """Wakes a blocking call of the streaming thread; called from another thread when stopping."""
        self.wake()

    def wants_upstream(self) -> Collection[str]:
        """Types of elements whose metadata it uses: a note says so where one is downstream instead."""
        return ()

    def check_properties(self) -> None:
        """Raises `PropertyError` where properties do not fit; called at the build and before the start."""

    def property_changed(self, name: str) -> None:
        """A property was set."""

    # Called by authors.

    def wake(self) -> None:
        """Makes every thread that waits look again at what it waits for."""
        with self._state_changed:
            self._woken.set()
            self._state_changed.notify_all()

    def post_warning(self, text: str, code: str = "") -> None:
        """Posts a warning message; `launch --strict` fails after one with the code `shortfall`."""
        self.post(Message(MessageKind.WARNING, self.name, text, {"code": code} if code else {}))

    def warn_once(self, text: str, subject: str = "") -> None:
        """Posts a warning, unless one of the subject, else with the text, was posted so in this run."""
        if (subject or text) not in self._warned_of:
            self._warned_of.add(subject or text)
            self.post_warning(text)

    def post_message(self, name: str, **fields: object) -> None:
        """Posts an element message with a name and fields."""
        self.post(Message(MessageKind.ELEMENT, self.name, name, {"name": name, **fields}))

    def count_drop(self, reason: str, n: int = 1) -> None:
        """Counts frames that were not delivered."""
        if n:
            self.drops[reason] += n

    def clock_ns(self) -> int:
        """The pipeline's monotonic clock, ns."""
        return self.clock.monotonic_ns()

    def wait_until_due(self, running_time_ns: int, delay_ns: int = 0) -> bool:
        """Waits until `delay_ns` after a running time, across pauses; False at a stop or flush."""
        flushes = self.flushes
        while not self.wait_on_clock(self.timing.due_ns(running_time_ns) + delay_ns):
            if not self.wait_while_paused(flushes):
                return False
        return True

    def wait_while_paused(self, flushes: int | None = None) -> bool:
        """Waits until the pipeline plays; False if it stops, flushes, or has begun to since `flushes`."""
        flushes = self.flushes if flushes is None else flushes
        with self.waiting():
            self.wait_for_state(lambda: self.timing.running.is_set() or self.must_give_up(flushes))
        return not self.must_give_up(flushes)

    def wait_for(self, condition: Callable[[], bool], poll_s: float = POLL_S) -> None:
        """Waits on `changed`, with its lock held, until a condition holds; checks it at least every `poll_s`.

        Raises:
            Flushing: the pipeline stops or flushes.
        """
        flushes = self.flushes
        while self.flushes != flushes or not condition():
            if self.must_give_up(flushes):
                raise Flushing(self.name)
            with self.waiting():
                self.changed.wait(poll_s)

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Context of a wait on purpose: the watchdog ignores the element."""
        before, self.is_waiting, began_ns = self.is_waiting, True, time.perf_counter_ns()
        try:
            yield
        finally:
            self.is_waiting = before
            if not before and self.activity is not None and self.activity[0] == "frame":
                self.waited_ns += time.perf_counter_ns() - began_ns

    def pipeline_error(self) -> Exception | None:
        """The failure that has ended the pipeline's run, or None."""
        return None if self.host is None else self.host.error

    def add_pad(self, template: str, name: str = "") -> Pad:
        """Makes a sometimes pad and the delayed links that wait for it."""
        pad = self.request_pad(self.pad_templates[template], name)
        if self.host is not None:
            self.host.pad_added(pad)
        return pad

    def no_more_pads(self) -> None:
        """Reports that all sometimes pads exist; links that still wait for one are warned of."""
        if self.host is not None:
            self.host.no_more_pads(self)

    def reconfigure(self) -> None:
        """Makes upstream renegotiate before its next frame, because the accepted caps have changed."""
        if self.host is not None:
            self.host.reconfigure(self)

    # Called by the engine.

    def begin_run(self) -> None:
        """Resets the state of an earlier run; called when the element is made, and before each run."""
        for pad in self.pads.values():
            pad.reset()
        for counts in (self.drops, self.results, self.outcomes):
            counts.clear()
        self._warned_of.clear()
        self.has_failed, self.waited_ns = False, 0

    def enter(self, call: str, now_ns: int, frame: Frame | None = None) -> None:
        """Records the start of a call by the engine: its name, time (perf_counter, ns) and frame."""
        self.activity = (call, now_ns, frame)
        self.at_work[0] = AT_WORK

    def leave(self) -> None:
        """Records the end of the call."""
        self.activity = None
        self.at_work[0] = IDLE

    @contextlib.contextmanager
    def calling(self, call: str) -> Iterator[None]:
        """Context of a call by the engine, as recorded by `enter` and `leave`."""
        self.enter(call, time.perf_counter_ns())
        try:
            yield
        finally:
            self.leave()

    def post(self, message: Message) -> None:
        """Posts a message on the bus; logs it if there is none."""
        if self.poster is not None:
            self.poster(message)
        else:
            log.warning("%s: %s", message.source, message.text)

    @contextlib.contextmanager
    def guarded(self) -> Iterator[None]:
        """Context that turns any exception but the engine's own into an `ElementFailure` of this element."""
        try:
            yield
        except (FlowStop, ElementFailure):
            raise
        except NotNegotiated:
            self.has_failed = True
            raise
        except (Exception, SystemExit) as cause:
            self.has_failed = True
            raise self.failure(cause) from cause

    def halt(self) -> None:
        """Ends the element's waits because the pipeline stops."""
        self.stopping.set()
        self.wake()

    def flush(self, *, begins: bool) -> None:
        """Begins or ends a flush, which drops held frames and ends waits; called in the flushing thread."""
        with self._state_changed:
            self.is_flushing = begins
            if begins:
                self.flushes += 1
        self.wake()

    def must_give_up(self, flushes: int) -> bool:
        """Whether a wait has to end: the pipeline stops, flushes, or has begun to since `flushes`."""
        return self.stopping.is_set() or self.is_flushing or self.flushes != flushes

    def wait_on_clock(self, due_ns: int) -> bool:
        """Waits until a time of the clock; False once the element is woken, and while it is paused."""
        with self._state_changed:
            if self._woken.is_set():
                self._woken = threading.Event()
            woken = self._woken  # set by whatever changes from here on
            if self.must_give_up(self.flushes) or not self.timing.running.is_set():
                return False
        with self.waiting():
            return self.clock.wait_until(due_ns, woken)

    def wait_while_flushing(self) -> None:
        """Waits until no flush is in progress.

        Raises:
            Flushing: the pipeline stops.
        """
        self.wait_for_state(lambda: not self.is_flushing or self.stopping.is_set())
        if self.stopping.is_set():
            raise Flushing(self.name)

    def wait_for_state(self, condition: Callable[[], bool]) -> None:
        """Waits until a condition of the pipeline's state holds, whatever else ends waits."""
        with self._state_changed:
            while not condition():
                self._state_changed.wait(POLL_S)

    def pads_changed(self) -> None:
        """Pads were added or removed, or push differently, while the graph streams."""

    def latency(self) -> tuple[int, int | None]:
        """Minimum and maximum latency that the element adds to live frames, ns; None is no maximum."""
        return 0, 0

    def failure(self, cause: BaseException, frame: Frame | None = None) -> ElementFailure:
        """The error of this element for an exception."""
        where = "" if frame is None else frame.describe()
        if isinstance(cause, StreamkitError):
            return ElementFailure(self.name, self.factory, cause, where)
        place, text = place_of(cause, type(self)), traceback_of(cause)
        return ElementFailure(self.name, self.factory, cause, where, place, text)

    def query_live(self) -> bool:
        """Whether the element's output comes from a live source; asks upstream."""
        return any(element.query_live() for element in self.upstream())

    def query_begin_ns(self) -> int:
        """Time of the first frame of what the source reads, wherever it starts to, ns; asks upstream."""
        return next((element.query_begin_ns() for element in self.upstream()), 0)

    def query_caps(self, pad: Pad) -> Caps:
        """Caps that `pad` can carry given the caps on the other side; its template still bounds them."""
        return ANY

    def receive_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Handles an event of a sink pad; returns the src pad and event to go on with, if any are left."""
        raise StateError(f"{pad.path}: {type(self).__name__} takes no events")

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that is called with each frame of a sink pad."""
        raise StateError(f"{pad.path}: {type(self).__name__} takes no frames")
