"""Registration of a frame to one seen before: corners, Lucas-Kanade, robust motion models, patches."""
