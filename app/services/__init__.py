"""The use cases: functions of the application context, which return plain values."""
