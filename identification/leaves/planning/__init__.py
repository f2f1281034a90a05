"""Which poses calibrate a machine best: ``plan``."""
