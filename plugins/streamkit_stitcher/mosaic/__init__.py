"""The mosaic: tiles that grow with the flight, seams, exposure, blending, frame files."""
