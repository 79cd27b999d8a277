"""MessagePrinter: the lines that `launch` prints while a pipeline runs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from streamkit.errors import ElementFailure
from streamkit.flow.messages import LostConnections, Message, MessageKind

if TYPE_CHECKING:
    from streamkit.cli.display import Display
    from streamkit.graph.pipeline import Pipeline


class MessagePrinter:
    """Prints errors, unless `quiet` also notes, warnings and interrupts, and with `verbose` everything.

    Attributes:
        quiet: whether to print errors only.
        shortfalls: warnings that something the pipeline is for was not made.
    """

    def __init__(self, pipeline: Pipeline, display: Display, *, verbose: bool, quiet: bool) -> None:
        self._pipeline, self._display = pipeline, display
        self._verbose, self.quiet = verbose, quiet
        self.shortfalls: list[str] = []
        self._is_starting = True
        self._printed: list[Message] = []  # while it started
        self._caps: dict[str, str] = {}  # by path of the src pad
        self._lost = LostConnections()
        pipeline.bus.watch(self._print_of_start)

    def _print_of_start(self, message: Message) -> None:
        """Prints a warning at once: it may announce minutes of compiling loops."""
        if self._is_starting and message.kind is MessageKind.WARNING:
            self.print(message)
            self._printed.append(message)

    def end_start(self) -> None:
        """The pipeline plays: from now on the loop that reads the bus prints warnings, too."""
        self._is_starting = False

    def print(self, message: Message) -> None:
        """Prints a message unless it is an error, or was printed while the pipeline started."""
        if any(message is other for other in self._printed):
            return
        source, name = message.source or "pipeline", message.fields.get("name")
        if message.is_shortfall:
            self.shortfalls.append(f"{message.source}: {message.text}")
        if self.quiet:
            return
        if message.kind is MessageKind.WARNING:
            self._display.print_line(f"warning: {source}: {message.text}")
        elif name == "note":
            self._display.print_line(f"note: {message.source}: {message.fields.get('text')}")
        elif self._verbose and message.kind is not MessageKind.ERROR:
            known = "state" if message.kind is MessageKind.STATE else "name"  # in the text already
            fields = " ".join(f"{key}={value}" for key, value in message.fields.items() if key != known)
            self._display.print_line(f"{message.kind}: {source}: {message.text} {fields}".rstrip())
        elif self._lost.update(message):  # after the warning that it was lost
            self._display.print_line(f"note: {message.source}: connected again")

    def print_notes(self, texts: Iterable[str]) -> None:
        """Prints notes on the description."""
        if not self.quiet:
            self._display.print_each("note", texts)

    def print_interrupt(self, text: str) -> None:
        """Prints what an interrupt has done."""
        if not self.quiet:
            self._display.print_line(f"interrupt: {text}")

    def print_error(self, text: str, error: Exception | None) -> None:
        """Prints an error; of an unexpected exception also the place."""
        if isinstance(error, ElementFailure) and error.place:
            if self._verbose:
                self._display.print_line(error.traceback)
            text += f" ({error.place})"
        self._display.print_line(f"error: {text}")

    def print_caps(self) -> None:
        """Prints the caps of links that have new ones."""
        if self.quiet or not self._verbose:
            return
        for src, sink in self._pipeline.graph.links():
            caps = str(src.caps) if src.caps is not None and not src.caps.is_any else ""
            if caps and self._caps.get(src.path) != caps:
                self._caps[src.path] = caps
                self._display.print_line(f"caps: {src.path} -> {sink.path}: {caps}")
