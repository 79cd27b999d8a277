"""The core's own elements; they move frames and know nothing of what is in them."""
