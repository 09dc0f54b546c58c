"""What an experimenter sees of a study under way: its sessions, how far they came, since when."""
