"""changemasksink: masks of change in files, as the tools of changedetection.net read them."""

from pathlib import Path

import cv2
import numpy as np

from streamkit import Frame, Property, ResourceError, Sink, write_remedy
from streamkit_differencer.pictures import only_things


class ChangeMaskSink(Sink):
    """Writes each mask as results/bin000001.png and so on: 255 is foreground, 0 is ground.

    To score a sequence, give it the folder results/CATEGORY/SEQUENCE. What has stopped counts as foreground,
    shadow does not.

    Example:
        videotestsrc num-buffers=5 ! framediff name=d ! fakesink d.mask ! changemasksink location=masks
    """

    sink = "video/x-raw, format=GRAY8"
    location: str = Property("", doc="Folder to write to; it is made if it is not there.")
    first_number: int = Property(1, min=0, doc="Number of the first frame.")
    prefix: str = Property("bin", doc="What file names begin with.")

    def start(self) -> None:
        """Makes the folder.

        Raises:
            ResourceError: there is no location, or it cannot be made.
        """
        if not self.location:
            raise ResourceError("location must be set to a folder; write for example location=results")
        self._number = self.first_number
        try:
            Path(self.location).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ResourceError(
                f"location={self.location}: cannot be made: {error.strerror}; name another folder"
            ) from error

    def render(self, frame: Frame) -> None:
        """Writes one mask.

        Raises:
            ResourceError: it cannot be written.
        """
        path = Path(self.location) / f"{self.prefix}{self._number:06d}.png"
        self._number += 1
        # Level 1: masks are mostly empty, and higher levels gain little for their time.
        _, encoded = cv2.imencode(".png", only_things(frame.data), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        try:
            path.write_bytes(np.asarray(encoded).tobytes())
        except OSError as error:
            raise ResourceError(
                f"{path}: cannot be written: {error.strerror}{write_remedy(error)}"
            ) from error
