"""Many feeds and whole archives, run by Ray."""
