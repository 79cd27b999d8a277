"""changemasksink: writes masks to image files, as the tools of changedetection.net read them."""

from pathlib import Path

import cv2
import numpy as np

from streamkit import Frame, Property, ResourceError, Sink, write_remedy
from streamkit_differencer.mask_values import binary_mask


class ChangeMaskSink(Sink):
    """Writes each mask as results/bin000001.png and so on: 255 is foreground, 0 is background.

    To score a sequence, set location=results/CATEGORY/SEQUENCE. Stopped objects count as foreground, shadow
    does not.

    Example:
        videotestsrc num-buffers=5 ! framediff name=d ! fakesink d.mask ! changemasksink location=masks
    """

    sink = "video/x-raw, format=GRAY8"
    location: str = Property("", doc="Folder to write to; created if missing.")
    first_number: int = Property(1, min=0, doc="Number of the first frame.")
    prefix: str = Property("bin", doc="Prefix of the file names.")

    def start(self) -> None:
        """Creates the folder.

        Raises:
            ResourceError: location is not set, or cannot be made.
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
        # Masks are mostly empty: higher levels gain little for their time.
        _, encoded = cv2.imencode(".png", binary_mask(frame.data), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        try:
            path.write_bytes(np.asarray(encoded).tobytes())
        except OSError as error:
            raise ResourceError(
                f"{path}: cannot be written: {error.strerror}{write_remedy(error)}"
            ) from error
