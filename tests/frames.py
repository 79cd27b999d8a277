"""The frames of a pipeline."""

from streamkit import Frame, Pipeline


def frames_of(description: str) -> list[Frame]:
    """All frames that leave a pipeline, which is described without its sink."""
    with Pipeline.parse(f"{description} ! appsink name=out max-buffers=0") as pipeline:
        pipeline.play()
        return list(pipeline["out"])
