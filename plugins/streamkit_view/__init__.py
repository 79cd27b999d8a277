"""A page that shows video, tracks and mosaic live: a subscriber of zenohsink that serves browsers.

`command` is `streamkit view`. `feed` receives what is published at one key, `hub` has a bounded
queue for each page and brings both together, `server` and `access` are HTTP, and `playback` runs the pipeline
of a file or camera.
"""
