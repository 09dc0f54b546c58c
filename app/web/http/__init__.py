"""What all routes share: security, limits, errors, concurrency, request log, translations."""
