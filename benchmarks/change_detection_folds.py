"""Leave-one-out folds: what a choice among variants gives on the sequence that took no part in it.

Each argument is a file with the output of `change_detection.py` for one variant; the first is the one in use
before. For each sequence the variant with the best mean F of all others is taken, and judged on it.

    python benchmarks/change_detection.py --still --set noise-gain=3 > three.txt
    python benchmarks/change_detection_folds.py before.txt three.txt ...
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np


def measures(path: Path) -> dict[str, float]:
    """F of each sequence as it is, from the table in a file."""
    rows = [line.split() for line in path.read_text().splitlines()[1:] if not line.startswith("mean")]
    return {row[0]: float(row[1]) for row in rows if row[1] != "shaken"}


def main(paths: list[Path]) -> None:
    """Prints a row per sequence, and the means."""
    tables = [measures(path) for path in paths]
    names = [name for name in tables[0] if all(name in table for table in tables)]
    values = np.array([[table[name] for name in names] for table in tables])
    print("| held-out sequence | before | chosen | F |\n|---|---|---|---|")
    held_out = []
    for index, name in enumerate(names):
        chosen = int(np.delete(values, index, axis=1).mean(axis=1).argmax())
        held_out.append(values[chosen, index])
        print(f"| {name} | {values[0, index]:.3f} | {paths[chosen].stem} | {held_out[-1]:.3f} |")
    best = int(values.mean(axis=1).argmax())
    print(f"| mean | {values[0].mean():.3f} | | {np.mean(held_out):.3f} |")
    print(f"\nThe best on all, {paths[best].stem}: {values[best].mean():.3f}")


if __name__ == "__main__":
    main([Path(text) for text in sys.argv[1:]])
