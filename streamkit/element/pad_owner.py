"""PadOwner: the pads of an element, as its class declares them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar, cast

from streamkit.element.pad import Direction, Pad, PadTemplate, Presence
from streamkit.errors import StateError
from streamkit.flow.caps import ANY, Caps

if TYPE_CHECKING:
    from streamkit.element.base import Element


class PadOwner:
    """The pads of an element, and the templates that its class declares.

    Attributes:
        pads: by name.
    """

    sink: ClassVar[str | Caps] = ""
    src: ClassVar[str | Caps] = ""
    templates: ClassVar[tuple[PadTemplate, ...]] = ()
    pad_templates: ClassVar[dict[str, PadTemplate]] = {}
    name: str
    lock: threading.RLock

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        always = {side: getattr(cls, side) for side in Direction}
        found = [PadTemplate(str(side), side, Caps(caps)) for side, caps in always.items() if caps]
        cls.pad_templates = {template.name: template for template in (*found, *cls.templates)}

    def __init__(self) -> None:
        super().__init__()
        self.pads: dict[str, Pad] = {
            template.name: Pad(cast("Element", self), template, template.name)
            for template in self.pad_templates.values()
            if template.presence is Presence.ALWAYS
        }
        # By template: the number after the highest in use. Looking at all pads for each new one takes long
        # for thousands of branches.
        self._next_numbers: dict[str, int] = {}

    def sink_pads(self) -> Iterator[Pad]:
        """The sink pads."""
        return (pad for pad in tuple(self.pads.values()) if not pad.is_src)

    def src_pads(self) -> Iterator[Pad]:
        """The src pads."""
        return (pad for pad in tuple(self.pads.values()) if pad.is_src)

    @property
    def src_pad(self) -> Pad:
        """The first src pad: `src`, if there is one."""
        return next(self.src_pads())

    def is_linked(self, name: str) -> bool:
        """Whether there is a pad of this name, and it is linked."""
        return name in self.pads and self.pads[name].peer is not None

    def check_declares_src(self, name: str) -> None:
        """Raises `StateError` where a frame is for a src pad that no template of the class allows."""
        declared = [
            template for template in self.pad_templates.values() if template.direction is Direction.SRC
        ]
        if not any(template.matches(name) for template in declared):
            raise StateError(
                f"a frame is for the pad {name!r}, which {type(self).__name__} does not declare; "
                f"it has {', '.join(template.name for template in declared)}"
            )

    def upstream(self) -> list[Element]:
        """The elements linked to the sink pads."""
        return [pad.peer.element for pad in self.sink_pads() if pad.peer is not None]

    def downstream(self) -> list[Element]:
        """The elements linked to the src pads."""
        return [pad.peer.element for pad in self.src_pads() if pad.peer is not None]

    @property
    def sink_caps(self) -> Caps:
        """Current caps of the pad `sink`; ANY before negotiation."""
        return self._caps_of("sink")

    @property
    def src_caps(self) -> Caps:
        """Current caps of the pad `src`; ANY before negotiation."""
        return self._caps_of("src")

    def _caps_of(self, pad_name: str) -> Caps:
        pad = self.pads.get(pad_name)
        return ANY if pad is None or pad.caps is None else pad.caps

    def request_pad(self, template: PadTemplate, name: str = "") -> Pad:
        """Makes a pad from a request or sometimes template, with the given name or the next number."""
        with self.lock:
            number = self._next_numbers.pop(template.name, None)
            if not name or "%u" in name:
                name = self._next_name(template, number)
            if name in self.pads:
                raise StateError(f"{self.name}: a pad {name!r} is there already")
            pad = self.pads[name] = Pad(cast("Element", self), template, name)
        return pad

    def _next_name(self, template: PadTemplate, number: int | None) -> str:
        """The template's name with `number`, or where that is None with the one after the highest in use."""
        if "%u" not in template.name:
            return template.name
        if number is None:
            taken = map(template.number, self.pads)
            number = max((known for known in taken if known is not None), default=-1) + 1
        self._next_numbers[template.name] = number + 1
        return template.name.replace("%u", str(number))

    def release_pad(self, pad: Pad) -> None:
        """Unlinks and removes a request pad."""
        pad.unlink()
        with self.lock:
            self.pads.pop(pad.name, None)
            self._next_numbers.pop(pad.template.name, None)


def walk(start: Iterable[Element], neighbours: Callable[[Element], Iterable[Element]]) -> Iterator[Element]:
    """The elements reachable from `start`, each once, the nearest first."""
    waiting = deque(start)
    seen: set[Element] = set()
    while waiting:
        element = waiting.popleft()
        if element not in seen:
            seen.add(element)
            yield element
            waiting.extend(neighbours(element))
