"""fakesrc: frames without content."""

from __future__ import annotations

from collections.abc import Iterator

from streamkit.element.property import Property
from streamkit.element.source import Source
from streamkit.errors import NotNegotiated
from streamkit.flow.caps import ANY, Caps
from streamkit.flow.frame import Frame


class FakeSrc(Source):
    """Makes frames of zero bytes of a given size, as fast as they are taken.

    Example:
        fakesrc num-buffers=10 ! fakesink
    """

    src = "ANY"

    num_buffers: int = Property(-1, min=-1, doc="Frames before EOS; -1 is endless.")
    sizemax: int = Property(0, min=0, max=2**31 - 1, unit="bytes", doc="Bytes in each frame.")
    is_live: bool = Property(False, doc="Pace the frames at 30 a second, as a camera would.")

    def negotiate(self, allowed: Caps) -> Caps:
        """Anything; where a filter follows it must say everything about the format."""
        if not allowed.is_any and not allowed.is_fixed:
            raise NotNegotiated(
                f"{self.name}: the caps that follow ({allowed}) do not completely specify the format; "
                "give every field one value"
            )
        return allowed

    def frames(self) -> Iterator[Frame]:
        """Numbered frames, all with the same bytes."""
        data, caps = bytes(self.sizemax), self.src_pad.caps or ANY
        count = 0
        while self.num_buffers < 0 or count < self.num_buffers:
            if self.is_live and self.stopping.wait(1 / 30):
                return
            yield Frame(data, caps, seq=count, arrival_ns=self.clock_ns())
            count += 1
