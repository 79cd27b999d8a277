"""Files in and out: media, numbered images, bytes and lines."""
