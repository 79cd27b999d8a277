"""Finds what moves: frame differences with a background model anchored to the ground (element `framediff`).

The modules follow one frame through the element: `anchor` says where the frame lies on the canvas that the
model is drawn on, `equations` and `model` tell foreground from background there, `illumination` keeps both at
one brightness, `objects` makes objects of the foreground, and `differencer` calls them in order. They work on
plain arrays and import nothing of the engine; `element` puts them into a pipeline.
"""
