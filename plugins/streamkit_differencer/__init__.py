"""Detection of moving objects: a background model anchored to the ground (element `framediff`).

The modules follow one frame through the element: `canvas` and `sampling` place the frame on the canvas of the
background model, `equations`, `foreground`, `noise`, `learning` and `model` tell foreground from background
on the state of `ground`, `illumination` follows changes of exposure, `filters` remove what is no object,
`objects` extracts objects from the foreground, and `differencer` calls them in order. They work on plain
arrays; `element` runs them in a pipeline.
"""
