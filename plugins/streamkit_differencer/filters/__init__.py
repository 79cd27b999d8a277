"""What looks like motion and is none: shadows, things that flicker, tall things seen from a moving camera."""
