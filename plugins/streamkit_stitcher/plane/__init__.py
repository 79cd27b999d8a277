"""Where the pictures of a stream lie on a reference plane: key pictures, their graph, the choice of plane."""
