"""Probes and transcodes untrusted videos in a child process with limits.

`decoder_client` is the interface. The child process imports nothing of the application but this
package, so that it starts quickly.
"""
