"""The use cases: each takes the studio, does one thing in one transaction, and returns values."""
