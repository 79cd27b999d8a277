"""Detection of moving objects: a background model anchored to the ground (element `framediff`).

The modules follow one frame through the element: `canvas` places the frame on the canvas of the background
model, `equations`, `foreground`, `noise`, `learning` and `model` separate foreground from background on the
state of `ground`, `illumination` follows changes of exposure, `objects` extracts objects from the foreground,
and `differencer` calls them in order. They work on plain arrays; `element` runs them in a pipeline.
"""
