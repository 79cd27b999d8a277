"""Element: the base class of everything in a graph, and the running graph as its elements see it."""

from __future__ import annotations

import contextlib
import logging
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from streamkit.element.code_place import place_of, traceback_of
from streamkit.element.pad import Pad
from streamkit.element.pad_owner import PadOwner
from streamkit.element.property_owner import PropertyOwner
from streamkit.element.waits import Waits
from streamkit.errors import ElementFailure, NotNegotiated, StateError, StreamkitError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.events import FlowStop
from streamkit.flow.messages import Message, MessageKind

if TYPE_CHECKING:
    from streamkit.element.pad import Pad
    from streamkit.flow.events import Event
    from streamkit.flow.frame import Frame
    from streamkit.flow.statistics import ElementStatistics

log = logging.getLogger("streamkit")
AT_WORK, IDLE = ord("1"), ord("0")


class Host:
    """The running graph, as elements see it; this base class is that of an element in no graph."""

    @property
    def error(self) -> Exception | None:
        """The failure that has ended the run, or None."""
        return None

    def elements(self) -> Sequence[Element]:
        """All elements of the graph, in textual order."""
        return ()

    def statistics(self, now_ns: int) -> Sequence[ElementStatistics]:
        """Counters of the elements, in textual order; those in other processes have none."""
        return ()

    def pad_added(self, pad: Pad) -> None:
        """Tries the delayed links of a pad that was added while the graph streams."""

    def no_more_pads(self, element: Element) -> None:
        """Reports delayed links of an element that adds no more pads."""

    def reconfigure(self, element: Element) -> None:
        """Renegotiates upstream of an element whose accepted caps have changed."""

    def sink_ended(self, element: Element) -> None:
        """A sink has drained after EOS."""
        element.post(Message(MessageKind.EOS, element.name))

    def prerolled(self, element: Element) -> None:
        """A sink of the paused graph holds its first frame."""


NO_HOST = Host()


class Element(PadOwner, PropertyOwner, Waits):
    """One element of a graph; its bases are its pads, its properties and its waits.

    Authors subclass `Source`, `Transform`, `Sink`, `Combine` or `Split`. They declare pads as caps in `sink`
    and `src` (always pads) or as `PadTemplate`s in `templates`, and properties with `Property(...)`, and
    override `start` and `stop` to acquire and release resources, and `begin_run` to reset the state of a run.

    Further class attributes: `presets` (property values by preset name), `uri_schemes` that `location`
    accepts in descriptions that contain only a URI, and the `rank` among elements with the same scheme.

    Attributes:
        name, factory: unique in its bin; element type.
        bin: the enclosing bin, or None.
        drops: number of frames not delivered, by reason.
        results: number of things that the element has made, such as tracks, by name in the plural.
        outcomes: number of frames by what the element has found of each, such as "lost".
        written_paths: of the first and the last file of the run; of a single one, or none, just those.
        has_failed: whether a call by the engine has raised in this run; the element is then not drained.
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
        self.host = NO_HOST
        self.drops: Counter[str] = Counter()
        self.results: Counter[str] = Counter()
        self.outcomes: Counter[str] = Counter()
        self.written_paths: tuple[str, ...] = ()
        self._warned_of: set[str] = set()
        self.at_work = memoryview(bytearray(b"0"))
        self.poster: Callable[[Message], None] | None = None
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

    def post_warning(self, text: str, code: str = "") -> None:
        """Posts a warning message; `launch --strict` fails after one with the code `shortfall`."""
        self.post(Message(MessageKind.WARNING, self.name, text, {"code": code} if code else {}))

    def warn_once(self, text: str, code: str = "") -> None:
        """Posts a warning, unless one with the code, else with the text, was posted so in this run."""
        if (code or text) not in self._warned_of:
            self._warned_of.add(code or text)
            self.post_warning(text, code)

    def post_message(self, name: str, **fields: object) -> None:
        """Posts an element message with a name and fields."""
        self.post(Message(MessageKind.ELEMENT, self.name, name, {"name": name, **fields}))

    def count_drop(self, reason: str, n: int = 1) -> None:
        """Counts frames that were not delivered."""
        if n:
            self.drops[reason] += n

    def pipeline_error(self) -> Exception | None:
        """The failure that has ended the pipeline's run, or None."""
        return self.host.error

    def add_pad(self, template: str, name: str = "") -> Pad:
        """Makes a sometimes pad and the delayed links that wait for it."""
        pad = self.request_pad(self.pad_templates[template], name)
        self.host.pad_added(pad)
        return pad

    def no_more_pads(self) -> None:
        """Reports that all sometimes pads exist; links that still wait for one are warned of."""
        self.host.no_more_pads(self)

    def reconfigure(self) -> None:
        """Makes upstream renegotiate before its next frame, because the accepted caps have changed."""
        self.host.reconfigure(self)

    # Called by the engine.

    def begin_run(self) -> None:
        """Resets the state of an earlier run; called when the element is made, and before each run."""
        for pad in self.pads.values():
            pad.reset()
        for counts in (self.drops, self.results, self.outcomes):
            counts.clear()
        self._warned_of.clear()
        self.has_failed, self.waited_ns, self.written_paths = False, 0, ()

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
