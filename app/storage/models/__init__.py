"""The ORM models, by subject."""
