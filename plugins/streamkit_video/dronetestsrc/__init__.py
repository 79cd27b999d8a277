"""dronetestsrc: aerial video of moving cars with exact ground truth."""
