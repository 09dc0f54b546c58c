"""Background work: the interface, and its local and remote implementations."""
