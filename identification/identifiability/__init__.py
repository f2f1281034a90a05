"""What poses can and cannot tell of a machine, in words: ``identifiability``."""
