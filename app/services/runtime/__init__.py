"""What every service rests on: errors, settings, ids, logs, metrics and child processes."""
