"""Image registration: corners, Lucas-Kanade, robust motion models, patch alignment."""
