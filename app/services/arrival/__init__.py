"""The arrival of participants: admission, capacity, entry links and re-entry."""
