"""Background work: the interface, its local and remote implementations, and jobs."""
