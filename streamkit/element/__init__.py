"""What an author writes against: bases, pads, properties, and the registry that finds elements."""
