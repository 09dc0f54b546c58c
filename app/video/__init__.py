"""Looking into videos and making others of them, apart from whoever asks: in a process with limits.

`decoding` is the door. What the process itself runs imports nothing of the house but this room, so
that it starts quickly.
"""
