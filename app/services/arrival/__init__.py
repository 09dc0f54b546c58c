"""How a participant gets in: admission, capacity, entry links and re-entry."""
