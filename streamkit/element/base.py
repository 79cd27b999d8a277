"""Element: the base of everything in a graph."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Self

from streamkit.element.pad import Pad, PadTemplate, Presence, declared_templates
from streamkit.element.property import PropertyDeclaration, declared_properties
from streamkit.element.timing import Timing
from streamkit.errors import ElementFailure, NotNegotiated, PropertyError, StateError
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.clock import Clock, SystemClock
from streamkit.flow.messages import Message, MessageKind
from streamkit.flow.signals import FlowStop

if TYPE_CHECKING:
    from streamkit.element.host import Host
    from streamkit.flow.events import Event
    from streamkit.flow.frame import Frame

log = logging.getLogger("streamkit")
PADS_LOCK = threading.Lock()  # pads come and go from several threads, seldom
AT_WORK, IDLE = b"10"
LOOK_S = 0.5  # longest sleep between looks at `stopping`, should a wake-up be missed


class Element:
    """One element of a graph.

    Authors subclass `Source`, `Transform`, `Sink`, `Combine` or `Split`, declare `sink` and `src` as caps
    texts (always pads) or `PadTemplate`s in `templates`, properties with `Property(...)`, and override
    `start` and `stop` where they hold something.

    Class attributes besides: `presets` (values of properties by the preset's name), `uri_schemes` that the
    element's `location` takes when only an address is written, and its `rank` among those that do.

    Attributes:
        name: unique in its bin.
        factory: name of its type.
        stopping: set while the pipeline stops; every wait of an element watches it.
        clock: the pipeline's clock.
        timing: the pipeline's running time.
        waking: set while waits are to end: the pipeline stops, is paused, or flushes.
        is_flushing: between a flush's start and its stop: frames are refused.
        flushes: how many flushes have begun; a wait in which the number grew has been flushed away.
        drops: frames not delivered, by reason.
        activity: the engine's call that the element is in: what for, since when (perf_counter, ns) and with
            which frame; None between calls. The watchdog reads it.
        is_waiting: whether the element waits on purpose, so that the watchdog does not take it for hung.
        at_work: one byte, "1" while the element is in a call, else "0"; a crash report reads it from shared
            memory.
    """

    sink: ClassVar[str | Caps] = ""
    src: ClassVar[str | Caps] = ""
    templates: ClassVar[tuple[PadTemplate, ...]] = ()
    pad_templates: ClassVar[dict[str, PadTemplate]] = {}
    properties: ClassVar[dict[str, PropertyDeclaration]] = {}
    defaults: ClassVar[dict[str, Any]] = {}
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {}
    uri_schemes: ClassVar[tuple[str, ...]] = ()
    rank: ClassVar[int] = 0

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        cls.properties = declared_properties(cls)
        cls.defaults = {item.attribute: item.default for item in cls.properties.values() if item.read is None}
        cls.pad_templates = declared_templates(cls)

    def __new__(cls, *args: Any, **kwargs: Any) -> Self:
        """A new element, its properties at their defaults."""
        self = super().__new__(cls)
        self.__dict__.update(cls.defaults)
        return self

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.factory = type(self).__name__.lower()
        self.name = name or self.factory
        self.parent = ""
        self.pads: dict[str, Pad] = {}
        self.stopping = threading.Event()
        self.waking = threading.Event()
        self.is_flushing = False
        self.flushes = 0
        self.clock: Clock = SystemClock()
        self.timing = Timing(lambda: self.clock)
        self.host: Host | None = None
        self.drops: Counter[str] = Counter()
        self.activity: tuple[str, int, Frame | None] | None = None
        self.is_waiting = False
        self.at_work = memoryview(bytearray(b"0"))
        self.poster: Callable[[Message], None] | None = None
        self.pipeline_error: Callable[[], Exception | None] = lambda: None
        self.is_playing = False
        self.set_in_text: dict[str, Any] = {}
        for template in self.pad_templates.values():
            if template.presence is Presence.ALWAYS:
                self.pads[template.name] = Pad(self, template, template.name)
        for key, value in properties.items():
            self.set_property(key, value)

    def __repr__(self) -> str:
        return f"<{self.factory} {self.name!r}>"

    # What an author overrides.

    def start(self) -> None:
        """Opens what the element needs; raises `ResourceError` where that cannot be had."""

    def stop(self) -> None:
        """Lets go of everything; always runs once `start` began, also after its failure."""

    def interrupt(self) -> None:
        """Wakes a blocking call of the streaming thread; called from another thread when stopping."""

    def property_changed(self, name: str) -> None:
        """A property was set."""

    # What an author calls.

    def post_warning(self, text: str) -> None:
        """Tells the application that something is not as it should be."""
        self.post(Message(MessageKind.WARNING, self.name, text))

    def post_message(self, name: str, **fields: object) -> None:
        """Posts an element message: `name` says what it is about, `fields` carry its content."""
        self.post(Message(MessageKind.ELEMENT, self.name, name, {"name": name, **fields}))

    def count_drop(self, reason: str, n: int = 1) -> None:
        """Counts frames that were not delivered."""
        self.drops[reason] += n

    def clock_ns(self) -> int:
        """The pipeline's monotonic clock, ns."""
        return self.clock.monotonic_ns()

    def wait_until_due(self, running_time_ns: int) -> bool:
        """Waits for a running time; pauses are waited through. False when stopping or flushed away."""
        flushes = self.flushes
        with self.waiting():
            while not self.clock.wait_until(self.timing.due_ns(running_time_ns), self.waking):
                if self.flushes != flushes or not self.wait_while_paused():
                    return False
        return True

    def wait_while_paused(self) -> bool:
        """Waits until the pipeline plays; False when stopping or flushed away."""
        flushes = self.flushes
        with self.waiting():
            while not self.stopping.is_set() and not self.is_flushing and self.flushes == flushes:
                if self.timing.running.wait(LOOK_S):
                    return not self.stopping.is_set() and self.flushes == flushes
        return False

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Within the block the element waits on purpose; the watchdog does not take it for hung."""
        before, self.is_waiting = self.is_waiting, True
        try:
            yield
        finally:
            self.is_waiting = before

    def add_pad(self, template: str, name: str = "") -> Pad:
        """Makes a sometimes pad: the stream turns out to have it. Links that wait for it are made now."""
        pad = self.request_pad(self.pad_templates[template], name)
        if self.host is not None:
            self.host.pad_added(pad)
        return pad

    def no_more_pads(self) -> None:
        """All sometimes pads are there; links that still wait for one are reported."""
        if self.host is not None:
            self.host.no_more_pads(self)

    def reconfigure(self) -> None:
        """What this element can take has changed: upstream is to negotiate anew before its next frame."""
        if self.host is not None:
            self.host.reconfigure(self)

    @property
    def sink_caps(self) -> Caps:
        """Caps in force on the pad `sink`; ANY before negotiation."""
        return self._caps_of("sink")

    @property
    def src_caps(self) -> Caps:
        """Caps in force on the pad `src`; ANY before negotiation."""
        return self._caps_of("src")

    def _caps_of(self, pad_name: str) -> Caps:
        pad = self.pads.get(pad_name)
        return ANY if pad is None or pad.caps is None else pad.caps

    # What the engine calls.

    def enter(self, call: str, now_ns: int, frame: Frame | None = None) -> None:
        """Notes that the engine calls the element: what for, when (perf_counter, ns), with which frame."""
        self.activity = (call, now_ns, frame)
        self.at_work[0] = AT_WORK

    def leave(self) -> None:
        """Notes that the call has returned."""
        self.activity = None
        self.at_work[0] = IDLE

    def post(self, message: Message) -> None:
        """Hands a message to the bus, or to the log while there is none."""
        if self.poster is not None:
            self.poster(message)
        else:
            log.warning("%s: %s", message.source, message.text)

    @contextlib.contextmanager
    def guarded(self, frame: Frame | None = None) -> Iterator[None]:
        """Within the block any exception but the engine's own becomes a failure that names this element."""
        try:
            yield
        except (FlowStop, ElementFailure, NotNegotiated):
            raise
        except Exception as cause:
            raise self.failure(cause, frame) from cause

    def halt(self) -> None:
        """Ends the element's waits: the pipeline is stopping."""
        self.waking.set()

    def flush(self, *, begins: bool) -> None:
        """A flush begins or ends: what is held is dropped and waits end; called in the flusher's thread."""
        self.is_flushing = begins
        if begins:
            self.flushes += 1
            self.waking.set()
        elif self.timing.running.is_set() and not self.stopping.is_set():
            self.rearm()

    def rearm(self) -> None:
        """Waits from now on are to last; those that were woken keep the event that woke them."""
        self.waking = threading.Event()

    def pads_changed(self) -> None:
        """Pads were added, taken away or given another way to push while the graph streams."""

    def latency(self) -> tuple[int, int | None]:
        """What the element adds to a live frame's age, ns: at least, and at most (None: no bound needed)."""
        return 0, 0

    def failure(self, cause: BaseException, frame: Frame | None = None) -> ElementFailure:
        """The error that names this element."""
        where = frame.describe() if frame is not None else ""
        return ElementFailure(self.name, self.factory, cause, where)

    def set_property(self, name: str, value: Any) -> None:
        """Sets a property by name; dashes and underscores are the same. One that can only be read warns.

        Raises:
            PropertyError: there is no such property, the value is refused, or it cannot change while playing.
        """
        declaration = self.find_property(name)
        if name.replace("-", "_") in declaration.aliases:
            self.post_warning(f"property {name} is called {declaration.spelling} now; use that name")
        if declaration.readonly:
            self.post_warning(f"property {declaration.spelling} can only be read; the value is ignored")
            return
        if self.is_playing and not declaration.live:
            raise PropertyError(
                f"{self.name}: property {name} cannot change while playing; stop the pipeline to set it"
            )
        setattr(self, declaration.attribute, value)

    @classmethod
    def declaration_of(cls, name: str) -> PropertyDeclaration | None:
        """The declaration of a property by its name or an older one; None where there is none."""
        plain = name.replace("-", "_")
        found = cls.properties.get(plain)
        return found or next((item for item in cls.properties.values() if plain in item.aliases), None)

    @classmethod
    def find_property(cls, name: str) -> PropertyDeclaration:
        """The declaration of a property; raises `PropertyError` with a suggestion where there is none."""
        declaration = cls.declaration_of(name)
        if declaration is None:
            from streamkit.element.suggest import did_you_mean

            hint = did_you_mean(name, [known.replace("_", "-") for known in cls.properties])
            raise PropertyError(f"{cls.__name__.lower()} has no property {name!r}{hint and '; ' + hint}")
        return declaration

    def sink_pads(self) -> Iterator[Pad]:
        """Pads that frames come in through."""
        return (pad for pad in tuple(self.pads.values()) if not pad.is_src)

    def src_pads(self) -> Iterator[Pad]:
        """Pads that frames leave through."""
        return (pad for pad in tuple(self.pads.values()) if pad.is_src)

    def query_live(self) -> bool:
        """Whether the frames that leave this element come from a live source: what upstream answers."""
        return any(pad.peer.element.query_live() for pad in self.sink_pads() if pad.peer is not None)

    def query_caps(self, pad: Pad) -> Caps:
        """What `pad` can carry, given what the element's other side can; the pad's template bounds it."""
        return ANY

    def pass_event(self, pad: Pad, event: Event) -> tuple[Pad, Event] | None:
        """Takes an event; the pad and event to go on with, where nothing else is left to do here."""
        self.receive_event(pad, event)
        return None

    def receive_event(self, pad: Pad, event: Event) -> None:
        """Takes an event that arrived at a sink pad."""
        raise StateError(f"{pad.path}: {type(self).__name__} takes no events")

    def receiver(self, pad: Pad) -> Callable[[Frame], None]:
        """The function that takes the frames of a sink pad."""
        raise StateError(f"{pad.path}: {type(self).__name__} takes no frames")

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Makes a pad from a request or sometimes template: of the name given, or the next number."""
        with PADS_LOCK:
            if not name or "%u" in name:
                name = self._next_name(template)
            if name in self.pads:
                raise StateError(f"{self.name}: a pad {name!r} is there already")
            pad = self.pads[name] = Pad(self, template, name)
        return pad

    def _next_name(self, template: PadTemplate) -> str:
        head, mark, tail = template.name.partition("%u")
        if not mark:
            return template.name
        taken = [name[len(head) : len(name) - len(tail)] for name in self.pads if template.matches(name)]
        return f"{head}{max(map(int, taken), default=-1) + 1}{tail}"

    def release_pad(self, pad: Pad) -> None:
        """Takes a request pad away."""
        pad.unlink()
        with PADS_LOCK:
            self.pads.pop(pad.name, None)

    def properties_set(self) -> dict[str, Any]:
        """The properties set in the text, as JSON values."""
        found = {}
        for name in self.set_in_text:
            declaration = self.find_property(name)
            found[name] = declaration.to_json(getattr(self, declaration.attribute))
        return found
