"""A participant's session: stages, queries, responses, undo, the state view, and deletion."""
