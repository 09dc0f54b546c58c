"""The answers of all people under a condition, judged together, whatever model each had."""
