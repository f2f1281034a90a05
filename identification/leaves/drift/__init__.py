"""Which constants move between recordings, and when to recalibrate: ``drift``."""
