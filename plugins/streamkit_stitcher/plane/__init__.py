"""Registration of a stream's frames to a reference plane: keyframes, their graph, the reference."""
