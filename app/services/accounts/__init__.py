"""Accounts of experimenters: sign-in, tokens, invitations, rate limits, and the audit log."""
