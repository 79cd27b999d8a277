"""changemasksink: writes masks to image files, as the tools of changedetection.net read them."""

import cv2
import numpy as np

from streamkit import Frame, IfExists, OutputFileSink, Property, PropertyError, StreamError
from streamkit.output.file import OutputFile
from streamkit_differencer.arrays import above
from streamkit_differencer.foreground import MAX_BACKGROUND, MOVING, SHADOW, STOPPED

_NO_MASK = np.ones(256, np.uint8)
_NO_MASK[[0, SHADOW, STOPPED, MOVING]] = 0


class ChangeMaskSink(OutputFileSink):
    """Writes each mask as results/bin000001.png and so on: 255 is foreground, 0 is background.

    To score a sequence, set location=results/CATEGORY/SEQUENCE. Stopped objects count as foreground, shadow
    does not. The files are numbered in the order of the masks: where `multifilesrc` begins at another number
    than 1, set first-number to its start-index. A video that is no mask is refused.

    Example:
        videotestsrc num-buffers=5 ! framediff name=d ! fakesink d.mask ! changemasksink location=masks
    """

    sink = "video/x-raw, format=GRAY8"
    example = "results"
    location: str = Property("", doc="Folder to write to; created if missing.")
    first_number: int = Property(1, min=0, doc="Number of the first frame.")
    prefix: str = Property("bin", doc="Prefix of the file names.")

    def pattern(self) -> str:
        """A numbered file of the folder for each frame."""
        return f"{self.location}/{self.prefix}%06d.png"

    def check_properties(self) -> None:
        """Refuses the name of a file: a folder of that name would be made."""
        if self.location.endswith(".png"):
            raise PropertyError(
                f"{self.name}: location={self.location}: names a folder, in which the masks are "
                f"{self.prefix}%06d.png; write for example location={self.example}, and prefix=NAME"
            )

    def start(self) -> None:
        """Numbers begin."""
        super().start()
        if self.if_exists is not IfExists.CONTINUE:
            self.number = self.first_number

    def begin(self) -> None:
        """Nothing is common to all files."""

    def write(self, frame: Frame) -> None:
        """Writes one mask.

        Raises:
            StreamError: the frame has values that no mask has.
        """
        if cv2.LUT(frame.data, _NO_MASK).any():
            value = int(frame.data[_NO_MASK[frame.data] > 0][0])
            raise StreamError(
                f"a mask has the values 0, {SHADOW}, {STOPPED} and {MOVING}, the frame has {value}; "
                "link the pad mask: framediff name=d d.mask ! changemasksink"
            )
        # Masks are mostly empty: higher levels gain little for their time.
        mask = above(frame.data, MAX_BACKGROUND)
        _, encoded = cv2.imencode(".png", mask, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        self.file = OutputFile(self.next_path(), is_whole=True)
        self.file.write(np.asarray(encoded).tobytes())
        self.file.finish()
