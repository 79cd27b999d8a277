"""From a description to a running graph: syntax, building, negotiation, streaming, the bus."""
