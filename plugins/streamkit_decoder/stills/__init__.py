"""Still photographs: where they were taken and how the camera looked, as their files tell."""
