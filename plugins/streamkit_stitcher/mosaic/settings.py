"""How mosaics are made."""

from dataclasses import dataclass

from streamkit.settings import setting
from streamkit_stitcher.mosaic.seams import SeamKind


@dataclass(frozen=True)
class RecorderSettings:
    """How mosaics are made; without a location there is only a preview.

    Attributes:
        first_number: added to the numbers of planes in the names of files.
    """

    location: str | None = setting(
        None, file="write", doc="Path of the mosaic, .png, .jpg or .tif; %d in it gives each plane a file."
    )
    final: bool = setting(
        True, doc="Adjust and blend all keyframes at the end; else write the mosaic as it was painted."
    )
    seam: SeamKind = setting(
        SeamKind.GRAPHCUT,
        doc="Seams of the final mosaic: half-way between frames, or from there moved around cars and trees.",
    )
    max_canvas_mpx: float = setting(
        64.0, min=1.0, max=1024.0, unit="Mpx", doc="Mosaic kept in memory; the rest goes to a temporary file."
    )

    first_number: int = 0
    max_geo_error_m: float = setting(
        30.0, min=0.0, unit="m", doc="Expected error above which a mosaic is not georeferenced."
    )
    save_interval: float = setting(
        30.0,
        min=0.0,
        unit="s",
        doc="Time between two saves of the mosaic as it was painted so far; 0 is at the end only.",
    )

    @property
    def memory_px(self) -> int:
        """`max_canvas_mpx` in px."""
        return round(self.max_canvas_mpx * 1e6)

    @property
    def is_stored(self) -> bool:
        """Whether frames are stored for a final mosaic."""
        return self.final and self.location is not None
