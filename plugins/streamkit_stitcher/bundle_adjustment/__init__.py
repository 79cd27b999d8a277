"""Sparse bundle adjustment of frames of a plane: homographies and plane points together."""
