"""What an instrument reads of a pose, and how noisily: one file per ``sensor.type``."""
