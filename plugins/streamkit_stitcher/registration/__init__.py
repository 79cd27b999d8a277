"""Registration of a picture to one seen before: corners, Lucas-Kanade, robust motion models, patches."""
