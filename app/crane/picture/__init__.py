"""How a fixed camera in the pit sees one run of the crane."""
