"""Where the frames of a stream lie on a reference plane: keyframes, their graph, the choice of plane."""
