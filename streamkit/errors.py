"""All errors that streamkit raises on purpose.

    StreamkitError
    ├── CapsSyntax             a caps text that cannot be parsed
    ├── CapsTooLarge           caps with too many alternatives
    ├── DescriptionError       a pipeline description that cannot become a graph; points into the text
    ├── PropertyError          a property that does not exist or refuses a value
    ├── PluginBroken           an entry point that cannot be loaded
    ├── NotNegotiated          two linked pads without common caps
    ├── ElementFailure         an element raised: names element, frame and cause
    ├── StateError             a call that the pipeline's state does not allow
    │   ├── HangDetected       a call of an element that did not return in time
    │   └── StartCancelled     a start that was cancelled
    ├── ProcessDied            the process of a bin that has ended by itself, or hangs
    └── ResourceError          a file, address or device that cannot be used
        └── StreamError        media that cannot be read

Each message says where, the rule, what it got, and the remedy.
"""

from __future__ import annotations

import contextlib
import errno
import re
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass

from streamkit.masking import presentable, star_secrets

MAX_NAME_LENGTH = 64
WRITE_REMEDIES = {
    errno.ENOSPC: "free some space",
    errno.EDQUOT: "free some space",
    errno.EBUSY: "name another file, or end what writes it",
    errno.EFBIG: (
        "the limit of a file's size is reached (ulimit -f, or the file system's): write several files"
    ),
    errno.EPIPE: "what read it has ended",
    errno.ECONNRESET: "check the address, and that the receiver runs",
    errno.ETIMEDOUT: "let it read on, or allow it more time with timeout-s=",
}


def did_you_mean(word: str, known: Iterable[str], similarity: float = 0.6) -> str:
    """A hint with the most similar known word, else the shortest that begins with it, or "".

    Args:
        word: as typed; one longer than any name has no hint.
        known: the names.
        similarity: least ratio of `difflib`, 0 to 1.
    """
    import difflib

    if len(word) > MAX_NAME_LENGTH:
        return ""
    by_lower_case = {name.lower(): name for name in known}
    nearest = difflib.get_close_matches(word.lower(), list(by_lower_case), n=1, cutoff=similarity)
    begun = [name for name in by_lower_case if len(word) > 1 and name.startswith(word.lower())]
    nearest += sorted(begun, key=len)
    return f'did you mean "{by_lower_case[nearest[0]]}"?' if nearest else ""


def write_remedy(error: Exception) -> str:
    """Remedy for a failed write, to append to the reason; "" if unknown.

    Args:
        error: `OSError`, or an error of a library with an `errno`.
    """
    number = getattr(error, "errno", None)
    if number in WRITE_REMEDIES:
        return f"; {WRITE_REMEDIES[number]}"
    refused = isinstance(error, OSError) and number not in (None, errno.EINVAL)
    return "; check that the directory is there and takes files" if refused else ""


class StreamkitError(Exception):
    """Base class; masks secrets in its text and bounds its length."""

    def __init__(self, *arguments: object) -> None:
        super().__init__(*(presentable(item) if isinstance(item, str) else item for item in arguments))


class CapsSyntax(StreamkitError, ValueError):
    """A caps text that cannot be parsed.

    Attributes:
        position: offset of the error, characters.
        length: of the invalid part, characters, at least 1.
        rule: what is wrong, without the text and the place.
        hint: a remedy, or "".
    """

    def __init__(
        self, message: str, position: int = 0, length: int = 1, *, rule: str = "", hint: str = ""
    ) -> None:
        super().__init__(message + (f"; {hint}" if hint else ""))
        self.position = position
        self.length = max(1, length)
        self.rule = presentable(rule or message)
        self.hint = presentable(hint)


class CapsTooLarge(StreamkitError, ValueError):
    """Caps with too many structures, or a field with too many alternatives."""


@dataclass(frozen=True, slots=True)
class Place:
    """A place in a description: 1-based line and column, length in characters."""

    line: int = 1
    column: int = 1
    length: int = 1


class DescriptionError(StreamkitError, ValueError):
    """A description that cannot become a graph.

    Attributes:
        code: one of `syntax`, `no-such-element`, `no-such-property`, `link`, `could-not-set-property`,
            `empty-bin`, `empty`, `no-such-pad`, `plugin-broken`, `not-negotiated`.
        message: what is wrong, without the place.
        place: where in the text.
        hint: a remedy, or "".
        secrets: assignments in the text, "password=...", whose values are masked.
    """

    def __init__(self, code: str, message: str, place: Place | None = None, hint: str = "") -> None:
        super().__init__(message + (f"; {hint}" if hint else ""))
        self.code = code
        self.message = presentable(message)
        self.place = place or Place()
        self.hint = presentable(hint)
        self.secrets: tuple[str, ...] = ()

    def at(self, place: Place) -> DescriptionError:
        """The same error at another place."""
        return DescriptionError(self.code, self.message, place, self.hint)

    def facts(self) -> dict[str, object]:
        """What programs read: code, message, line, column, length, hint."""
        return {"code": self.code, "message": self.message, **asdict(self.place), "hint": self.hint}

    def pointed(self, text: str, origin: str = "description") -> str:
        """The error with its line of the text and carets under the place; secrets are masked."""
        text = star_secrets(text)
        for secret in self.secrets:
            name_length = secret.find("=") + 1
            text = text.replace(secret, secret[:name_length] + re.sub(".", "*", secret[name_length:]))
        lines = text.split("\n")
        line = lines[min(self.place.line, len(lines)) - 1]
        start = min(self.place.column - 1, len(line))
        window = max(0, start - 60)
        shown = "".join(mark if mark.isprintable() else " " for mark in line[window : window + 120])
        carets = "^" * max(1, min(self.place.length, len(shown) - (start - window)))
        place = f"{origin}:{self.place.line}:{self.place.column}"
        return f"{place}: {self}\n    {shown}\n    {' ' * (start - window)}{carets}"


class PropertyError(StreamkitError, ValueError):
    """A property that does not exist or refuses a value."""


class PluginBroken(StreamkitError, ImportError):
    """An entry point that cannot be loaded: names element, package, version, cause and remedy."""


class NotNegotiated(StreamkitError):
    """Two linked pads without common caps, or caps that an element refuses."""


class StateError(StreamkitError, RuntimeError):
    """A call that is not allowed in the current state."""


class HangDetected(StateError):
    """A call of an element did not return in time; its thread is abandoned."""


class StartCancelled(StateError):
    """The start of a pipeline was cancelled by `Pipeline.cancel`; started elements are stopped."""


class ResourceError(StreamkitError, OSError):
    """A file, address or device that cannot be used."""


@contextlib.contextmanager
def needs_extra(user: str, extra: str) -> Iterator[None]:
    """Context in which what needs a library of an extra is imported or runs.

    Args:
        user: who needs it, in words.
        extra: of streamkit, that installs it.

    Raises:
        ResourceError: the library is not installed.
    """
    try:
        yield
    except ImportError as error:
        missing = f"{user} needs {error.name or error}, which is not installed"
        raise ResourceError(f"{missing}; install it with: pip install 'streamkit[{extra}]'") from error


class StreamError(ResourceError):
    """Media that cannot be read."""


class ProcessDied(StreamkitError, RuntimeError):
    """The process of a bin has ended by itself, or does not answer."""


class ElementFailure(StreamkitError, RuntimeError):
    """An element raised an exception.

    Attributes:
        element: name in the graph.
        factory: element type.
        frame: the current frame, for example "frame seq=12 pts=0.480 s", or "".
        cause: the exception.
        place: where it left the element's code, as "file.py:12"; "" if it is an error of streamkit.
        traceback: its traceback as text; "" if it is an error of streamkit.
    """

    def __init__(
        self,
        element: str,
        factory: str,
        cause: BaseException,
        frame: str = "",
        place: str = "",
        traceback: str = "",
    ) -> None:
        what, kind_of_cause = str(cause).removeprefix(f"{element}: "), type(cause).__name__
        if not what:
            what = kind_of_cause
        elif not isinstance(cause, StreamkitError):
            what = f"{kind_of_cause}: {what}"
        if isinstance(cause, ValueError) and what.endswith("is read-only"):  # numpy's words
            what += ": frames are shared, write into the copy of frame.writable()"
        if isinstance(cause, AttributeError) and what.endswith("immutable type: 'Frame'"):  # msgspec's
            what += ": frames are shared, frame.replace(pts=...) gives a changed copy"
        kind = f" ({factory})" if factory and factory != element.rstrip("0123456789") else ""
        super().__init__(f"{element}{kind}: {what}" + (f" [at {frame}]" if frame else ""))
        self.element = element
        self.factory = factory
        self.frame = presentable(frame)
        self.cause = cause
        self.place = place
        self.traceback = traceback
