"""Pages of experimenters, admins and reviewers."""
