"""fakesrc: produces frames of arbitrary bytes."""

from __future__ import annotations

import functools
import itertools
import random
from collections.abc import Callable, Iterator
from typing import Any

from typing_extensions import override

from streamkit.element.property import Property
from streamkit.element.property_text import INT, UINT, Choice
from streamkit.element.source import Source
from streamkit.elements.frame_report import Callbacks, report_frame
from streamkit.errors import NotNegotiated
from streamkit.flow.caps import Caps
from streamkit.flow.clock import SECOND_NS
from streamkit.flow.frame import Frame

PATTERN = bytes(range(256))


class StreamFormat(Choice):
    """Unit of stream positions."""

    UNDEFINED = "undefined", 0, "GST_FORMAT_UNDEFINED"
    DEFAULT = "default", 1, "GST_FORMAT_DEFAULT"
    BYTES = "bytes", 2, "GST_FORMAT_BYTES"
    TIME = "time", 3, "GST_FORMAT_TIME"
    BUFFERS = "buffers", 4, "GST_FORMAT_BUFFERS"
    PERCENT = "percent", 5, "GST_FORMAT_PERCENT"


class SizeType(Choice):
    """Size of frames."""

    EMPTY = "empty", 1, "Send empty buffers"
    FIXED = "fixed", 2, "Fixed size buffers (sizemax sized)"
    RANDOM = "random", 3, "Random sized buffers (sizemin <= size <= sizemax)"


class FillType(Choice):
    """Content of frames."""

    NOTHING = "nothing", 1, "Leave data as malloced"
    ZERO = "zero", 2, "Fill buffers with zeros"
    RANDOM = "random", 3, "Fill buffers with random data"
    PATTERN = "pattern", 4, "Fill buffers with pattern 0x00 -> 0xff"
    PATTERN_SPAN = "pattern-span", 5, "Fill buffers with pattern 0x00 -> 0xff that spans buffers"


class DataType(Choice):
    """Allocation of frames."""

    ALLOCATE = "allocate", 1, "Allocate data"
    SUBBUFFER = "subbuffer", 2, "Subbuffer data"


class FakeSrc(Source):
    """Produces frames of a given size and content as fast as downstream accepts them, or 30/s with is-live.

    Attributes:
        on_handoff: called with (frame, pad) before each frame is sent, if `signal-handoffs` is on.

    Example:
        fakesrc num-buffers=10 ! fakesink
    """

    src = "ANY"

    num_buffers: int = Property(-1, min=-1, max=INT, doc="Frames before EOS; -1 is endless.")
    sizetype: SizeType = Property(SizeType.EMPTY, doc="Empty, fixed or random frame sizes.")
    sizemin: int = Property(0, min=0, max=INT, unit="bytes", doc="Minimum of random sizes.")
    sizemax: int = Property(4096, min=0, max=INT, unit="bytes", doc="Fixed size, or maximum of random sizes.")
    filltype: FillType = Property(FillType.NOTHING, doc="Content of frames; `nothing` is zeros, too.")
    data: DataType = Property(DataType.ALLOCATE, doc="Allocate each frame, or cut it from a larger buffer.")
    parentsize: int = Property(40960, min=0, max=INT, unit="bytes", doc="Size of that buffer.")
    datarate: int = Property(0, min=0, max=INT, unit="bytes/s", doc="Timestamps by this rate; 0 is off.")
    sync: bool = Property(False, doc="With datarate: send each frame at its running time.")
    do_timestamp: bool = Property(False, doc="Timestamp each frame with the running time.")
    is_live: bool = Property(False, doc="Send 30 frames/s, as a camera.")
    silent: bool = Property(True, live=True, doc="Keep no text in last-message.")
    signal_handoffs: bool = Property(False, doc="Call `on_handoff` with each frame.")
    dump: bool = Property(False, doc="Post the bytes of each frame as a message.")
    last_message: str | None = Property(None, readonly=True, doc="The last action, unless silent.")
    blocksize: int = Property(4096, min=0, max=UINT, doc="Accepted, without effect: see sizemax.")
    can_activate_push: bool = Property(True, doc="Accepted, without effect: frames are always pushed.")
    can_activate_pull: bool = Property(True, doc="Accepted, without effect: frames are never pulled.")
    format: StreamFormat = Property(StreamFormat.BYTES, doc="Accepted, without effect: times are ns.")

    def __init__(self, name: str = "", **properties: Any) -> None:
        self.on_handoff = Callbacks()
        super().__init__(name, **properties)

    def negotiate(self, allowed: Caps) -> Caps:
        """Accepts ANY or fixed caps from downstream."""
        if not allowed.is_any and not allowed.is_fixed:
            raise NotNegotiated(
                f"{self.name}: the caps that follow ({allowed}) do not completely specify the output format; "
                "give every field one value"
            )
        return allowed

    @override
    def frames(self) -> Iterator[Frame]:
        pad = self.src_pad
        caps = self.src_caps
        numbers = range(self.num_buffers) if self.num_buffers >= 0 else itertools.count()
        make_data = self._data_maker()
        sent = 0
        for number in numbers:
            if self.is_live and self.over.wait(1 / 30):
                return
            content = make_data()
            pts, duration = self._times(sent, len(content))
            if self.sync and pts is not None and not self.wait_until_due(pts):
                return
            sent += len(content)
            frame = Frame(content, caps, pts, duration, seq=number, arrival_ns=self.clock_ns())
            report_frame(self, "create", pad, frame, frame, pad)
            yield frame

    def _times(self, sent: int, size: int) -> tuple[int | None, int | None]:
        """Timestamp and duration, ns, of a frame after `sent` bytes."""
        if self.datarate:
            begin, end = (count * SECOND_NS // self.datarate for count in (sent, sent + size))
            return begin, end - begin
        if self.do_timestamp or self.is_live:
            return self.timing.running_time_ns(), None
        return None, None

    def _data_maker(self) -> Callable[[], bytes | memoryview]:
        """A function that returns the bytes of the next frame."""
        chance = random.Random(0)
        fill = self._filler(chance)

        def size() -> int:
            if self.sizetype is SizeType.RANDOM:
                return chance.randint(min(self.sizemin, self.sizemax), self.sizemax)
            return self.sizemax if self.sizetype is SizeType.FIXED else 0

        if self.data is DataType.ALLOCATE:
            return lambda: fill(size())
        whole, used = memoryview(b""), 0

        def part() -> memoryview:
            nonlocal whole, used
            wanted = size()
            if used + wanted > len(whole):
                whole, used = memoryview(fill(max(self.parentsize, wanted))), 0
            used += wanted
            return whole[used - wanted : used]

        return part

    def _filler(self, chance: random.Random) -> Callable[[int], bytes]:
        """A function that returns the given number of bytes."""
        endless = itertools.cycle(PATTERN)
        fillers: dict[FillType, Callable[[int], bytes]] = {
            FillType.RANDOM: chance.randbytes,
            FillType.PATTERN: lambda size: (PATTERN * (size // 256 + 1))[:size],
            FillType.PATTERN_SPAN: lambda size: bytes(itertools.islice(endless, size)),
        }
        zeros = functools.lru_cache(1)(bytes)  # the same for frames of one size
        return fillers.get(self.filltype, zeros)
