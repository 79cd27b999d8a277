"""The published tables: accuracy next to the printed values and to scikit-learn and scikit-image.

Run it:  STREAMKIT_DATA=FOLDER python benchmarks/paper.py --output out/experiments
The same as `streamkit experiments`; docs/paper-tables.md holds the result.
"""

from __future__ import annotations

import typer

from streamkit_wavelet_eigen.experiments.command import experiments

if __name__ == "__main__":
    typer.run(experiments)
