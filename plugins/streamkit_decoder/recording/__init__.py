"""Recording: packets as they came, encoded pictures, single pictures; and playing a recording again."""
