"""Commands by subject; `app.cli` puts them together."""
