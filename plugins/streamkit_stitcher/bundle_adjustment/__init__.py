"""Sparse bundle adjustment of pictures of a plane: homographies and plane points, solved together."""
