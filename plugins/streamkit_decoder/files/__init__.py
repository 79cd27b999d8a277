"""Files in and out: media, numbered pictures, bytes and lines."""
